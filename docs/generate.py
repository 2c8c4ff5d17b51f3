"""Writes what follows from the program itself: the pages of the profiles, the options of the commands,
the keys of the gateway's tables, and the tables of the Wireshark dissector.

python docs/generate.py            write them
python docs/generate.py --check    exit 1 where one is stale
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields
from pathlib import Path

import click
import wireshark_tables

from multidrop.catalog import load_profile, profile_names
from multidrop.cli.main import COMMANDS, cli
from multidrop.gateway.settings import CLASSES
from multidrop.profile import PointDescription, Profile
from multidrop.protocols import PROTOCOLS

DOCS = Path(__file__).resolve().parent
PROFILES = Path("reference/profiles")
COMMAND_LINE = Path("reference/command-line.md")
CONFIGURATION = Path("reference/configuration.md")
MANY = 20  # points that begin alike have a table of their own
SHARED = {
    "json",
    "trace",
    "capture",
    "profile",
    "config",
    "help",
}  # options that most commands have


def pages() -> dict[Path, str]:
    """Every generated page, by its path below docs/."""
    profiles = [load_profile(name) for name in _announced()]
    written = {PROFILES / f"{profile.name}.md": _profile(profile) for profile in profiles}
    written[PROFILES / "index.md"] = _index(profiles)
    text = (DOCS / COMMAND_LINE).read_text(encoding="utf-8")
    for name in set(COMMANDS) - set(re.findall(r"<!-- options: ([\w-]+)[\w -]* -->", text)):
        raise SystemExit(f"docs/{COMMAND_LINE} says nothing of the command {name!r}")
    written[COMMAND_LINE] = re.sub(
        r"(<!-- options: ([\w -]+) -->\n).*?(<!-- end -->)", _options, text, flags=re.DOTALL
    )
    text = (DOCS / CONFIGURATION).read_text(encoding="utf-8")
    for name in set(CLASSES) - set(re.findall(r"<!-- keys: (\w+) -->", text)):
        raise SystemExit(f"docs/{CONFIGURATION} says nothing of [{name}]")
    written[CONFIGURATION] = re.sub(
        r"(<!-- keys: (\w+) -->\n).*?(<!-- end -->)", _keys, text, flags=re.DOTALL
    )
    lua = (DOCS / wireshark_tables.LUA).read_text(encoding="utf-8")
    written[wireshark_tables.LUA] = wireshark_tables.with_tables(lua)
    return written


def _announced() -> list[str]:
    """Profiles whose protocol the program speaks."""
    from multidrop.errors import UsageError

    found = []
    for name in profile_names():
        try:
            profile = load_profile(name)
        except UsageError:
            continue
        if profile.protocol in PROTOCOLS:
            found.append(name)
    return found


# -- profiles --------------------------------------------------------------------------------


def _index(profiles: list[Profile]) -> str:
    lines = [
        "# Profiles",
        "",
        "What multidrop knows of each device model, one page a profile. The pages are made from",
        "the files in `src/multidrop/profiles` by `python docs/generate.py`.",
        "",
        *_table(
            ("profile", "model", "protocol", "points"),
            [
                (f"[{item.name}]({item.name}.md)", item.title, item.protocol, str(len(item.points)))
                for item in profiles
            ],
        ),
    ]
    return "\n".join(lines) + "\n"


def _profile(profile: Profile) -> str:
    lines = [f"# {profile.name}: {profile.title}", ""]
    lines += [f"- protocol: {profile.protocol}"]
    if profile.dialect:
        lines.append(f"- dialect: {profile.dialect}")
    if profile.baud or profile.format:
        lines.append(f"- line: {profile.baud or ''} {profile.format or ''}".rstrip())
    for prefix, offset in profile.inferred.items():
        lines.append(
            f"- `{prefix}N` stands for N + {offset}: inferred, so it is read-only without `--force`"
        )
    if profile.notes:
        lines += ["", profile.notes.strip()]
    lines.append("")
    if profile.points:
        lines += _points(profile)
    else:
        lines.append("It has no points: name them by their numbers.")
    return "\n".join(lines) + "\n"


def _points(profile: Profile) -> list[str]:
    """One table, or several with a heading where points are numbered (loop0_..., ai3_...)."""
    groups: dict[str, list[PointDescription]] = {}
    for point in profile.points.values():
        groups.setdefault(_group(point, profile), []).append(point)
    lines = _points_table(groups.pop("", []), profile)
    for group, points in groups.items():
        lines += ["", f"## {group}", "", *_points_table(points, profile)]
    return lines


def _group(point: PointDescription, profile: Profile) -> str:
    """`loop0` where many points begin so, `ai` for ai0_... to ai8_..., nothing for all others."""
    first = point.name.partition("_")[0]
    if not first[-1].isdigit():
        return ""
    alike = sum(name.startswith(f"{first}_") for name in profile.points)
    return first if alike >= MANY else first.rstrip("0123456789")


def _points_table(points: list[PointDescription], profile: Profile) -> list[str]:
    if not points:
        return []
    rows = {
        "name": [f"`{point.name}`" for point in points],
        "point": [f"`{point.at}`" for point in points],
        "type": [_type(point, profile) for point in points],
        **{head: [cell(point) for point in points] for head, cell in COLUMNS.items()},
    }
    columns = {head: cells for head, cells in rows.items() if any(cells)}
    return _table(list(columns), list(zip(*columns.values(), strict=True)))


def _type(point: PointDescription, profile: Profile) -> str:
    """The type with length and elements; the protocol's where the point's own text has none."""
    name = point.type
    if name is None and ":" not in point.at:
        name = PROTOCOLS[profile.protocol].device(0, profile, {}).point(point.name).type
    length = f"{point.length} characters" if point.length else ""
    elements = f"{point.elements} elements" if point.elements else ""
    return ", ".join(filter(None, (name, length, elements)))


def _limits(point: PointDescription) -> str:
    ends = [f"{end:.10g}" if end is not None else "" for end in (point.minimum, point.maximum)]
    step = f"multiples of {point.step:.10g}" if point.step else ""
    excluded = f"not {', '.join(f'{value:.10g}' for value in point.excluded)}"
    limits = "..".join(ends) if any(ends) else ""
    return ", ".join(filter(None, (limits, step, excluded if point.excluded else "")))


def _values(point: PointDescription) -> str:
    bits = [f"bit {bit} {name}" for bit, name in enumerate(point.bits) if name]
    names = [f"{raw} {name}" for raw, name in point.names.items()]
    return ", ".join(["in hex"] * point.hexadecimal + names + bits)


def _meaning_of(point: PointDescription) -> str:
    derived = "follows by a rule from other points" if point.derived else ""
    return "; ".join(filter(None, (point.meaning, point.note, derived)))


COLUMNS: dict[str, Callable[[PointDescription], str]] = {
    "role": lambda point: point.role.value,
    "access": lambda point: point.access,
    "functions": lambda point: point.functions,
    "limits": _limits,
    "default": lambda point: "" if point.default is None else str(point.default),
    "unit": lambda point: point.unit or "",
    "scale": lambda point: "" if point.scale == 1 else f"{point.scale:.10g}",
    "meaning": _meaning_of,
    "values": _values,
    "source": lambda point: point.source,
}
"""What a profile page shows of a point behind name, point and type.

A column that is empty for a whole table is left away."""


# -- options ---------------------------------------------------------------------------------


def _options(found: re.Match[str]) -> str:
    name = found[2]
    if name == "shared":
        options = [item for item in _declared("write") if _is_shared(item)]
    else:
        if name.partition(" ")[0] not in COMMANDS:
            raise SystemExit(f"{COMMAND_LINE}: there is no command {name!r}")
        options = [item for item in _declared(name) if not _is_shared(item)]
    rows = [(f"`{_spelled(item)}`", _meaning(item)) for item in options]
    body = "\n".join(_table(("option", "meaning"), rows)) if rows else "No options of its own."
    return f"{found[1]}{body}\n{found[3]}"


def _declared(name: str) -> list[click.Option]:
    command: click.Command | None = cli
    for word in name.split():  # a command, or one of a command's own
        assert isinstance(command, click.Group)
        command = command.get_command(click.Context(command), word)
    assert command is not None
    return [item for item in command.params if isinstance(item, click.Option) and not item.hidden]


def _is_shared(option: click.Option) -> bool:
    name = option.name or ""
    return name.startswith("key_") or name in SHARED


def _spelled(option: click.Option) -> str:
    return option.opts[0] + ("" if option.is_flag else f" {option.metavar or 'N'}")


def _meaning(option: click.Option) -> str:
    return (option.help or "") + ("; needed" if option.required else "")


# -- keys of the gateway's tables ------------------------------------------------------------


def _keys(found: re.Match[str]) -> str:
    rows = [
        (f"`{item.name}`", _default(item.default), item.metadata["meaning"])
        for item in fields(CLASSES[found[2]])
    ]
    body = "\n".join(_table(("key", "default", "meaning"), rows))
    return f"{found[1]}{body}\n{found[3]}"


def _default(value: object) -> str:
    if value is MISSING:
        return "needed"
    if value is None:
        return "none"
    if value == ():
        return "`[]`"
    return f"`{str(value).lower()}`" if isinstance(value, bool) else f"`{value}`"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    escaped = [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    return [
        "| " + " | ".join(heads) + " |",
        "|" + "---|" * len(heads),
        *("| " + " | ".join(row) + " |" for row in escaped),
    ]


def main(arguments: list[str]) -> int:
    """Write or check; returns the exit status."""
    if arguments not in ([], ["--check"]):
        print(__doc__, file=sys.stderr)
        return 2
    wanted = pages()
    left_over = {path.relative_to(DOCS) for path in (DOCS / PROFILES).glob("*.md")} - set(wanted)
    stale = [
        page
        for page, text in wanted.items()
        if not (DOCS / page).exists() or (DOCS / page).read_text(encoding="utf-8") != text
    ]
    if arguments:
        for page in [*stale, *left_over]:
            print(f"docs/{page} is stale: python docs/generate.py", file=sys.stderr)
        return 1 if stale or left_over else 0
    for page in stale:
        (DOCS / page).parent.mkdir(parents=True, exist_ok=True)
        (DOCS / page).write_text(wanted[page], encoding="utf-8")
        print(f"docs/{page}")
    for page in left_over:
        (DOCS / page).unlink()
        print(f"docs/{page} removed")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
