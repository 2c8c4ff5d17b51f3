"""Writes the pages that follow from the program itself: profiles, and the options of the commands.

python docs/generate.py            write them
python docs/generate.py --check    exit 1 where one is stale
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import MISSING, fields
from pathlib import Path

import click

from multidrop.catalog import load_profile, profile_names
from multidrop.cli.main import COMMANDS, cli
from multidrop.profile import PointDescription, Profile

DOCS = Path(__file__).resolve().parent
PROFILES = Path("reference/profiles")
COMMAND_LINE = Path("reference/command-line.md")
SHARED = {"json", "trace", "profile", "config", "help"}  # options that most commands have
HEADS = {"at": "point", "minimum": "minimum", "names": "values"}  # where a key is no word


def pages() -> dict[Path, str]:
    """Every generated page, by its path below docs/."""
    profiles = [load_profile(name) for name in _announced()]
    written = {PROFILES / f"{profile.name}.md": _profile(profile) for profile in profiles}
    written[PROFILES / "index.md"] = _index(profiles)
    text = (DOCS / COMMAND_LINE).read_text(encoding="utf-8")
    written[COMMAND_LINE] = re.sub(
        r"(<!-- options: ([\w-]+) -->\n).*?(<!-- end -->)", _options, text, flags=re.DOTALL
    )
    return written


def _announced() -> list[str]:
    """Profiles whose protocol the program speaks."""
    from multidrop.errors import UsageError
    from multidrop.protocols import PROTOCOLS

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
    points = list(profile.points.values())
    known = fields(PointDescription)
    used = [
        item.name
        for item in known
        if any(getattr(point, item.name) != _default(item) for point in points)
    ]
    heads = [HEADS.get(name, name) for name in used]
    rows = [[_cell(name, getattr(point, name)) for name in used] for point in points]
    return _table(heads, rows)


def _default(item: object) -> object:
    default, factory = getattr(item, "default", MISSING), getattr(item, "default_factory", MISSING)
    return default if factory is MISSING else factory()


def _cell(name: str, value: object) -> str:
    if value is None or value == "" or value == [] or value == {}:
        return ""
    if name in ("name", "at"):
        return f"`{value}`"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {word}" for key, word in value.items())
    if isinstance(value, list):
        return ", ".join(str(word) for word in value)
    return str(value).strip()


# -- options ---------------------------------------------------------------------------------


def _options(found: re.Match[str]) -> str:
    name = found[2]
    if name == "shared":
        options = [item for item in _declared("write") if _is_shared(item)]
    else:
        if name not in COMMANDS:
            raise SystemExit(f"{COMMAND_LINE}: there is no command {name!r}")
        options = [item for item in _declared(name) if not _is_shared(item)]
    rows = [(f"`{_spelled(item)}`", _meaning(item)) for item in options]
    body = "\n".join(_table(("option", "meaning"), rows)) if rows else "No options of its own."
    return f"{found[1]}{body}\n{found[3]}"


def _declared(name: str) -> list[click.Option]:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    return [item for item in command.params if isinstance(item, click.Option) and not item.hidden]


def _is_shared(option: click.Option) -> bool:
    name = option.name or ""
    return name.startswith("key_") or name in SHARED


def _spelled(option: click.Option) -> str:
    return option.opts[0] + ("" if option.is_flag else f" {option.metavar or 'N'}")


def _meaning(option: click.Option) -> str:
    return (option.help or "") + ("; needed" if option.required else "")


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
