"""`multidrop learn`."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import click

from multidrop.catalog import check_points, profile_file
from multidrop.cli.failures import failure_as_line, report_failure
from multidrop.cli.options import Common, common
from multidrop.cli.words import json_line, with_unit
from multidrop.errors import UsageError
from multidrop.io.audit import jsonable
from multidrop.io.connection import Target
from multidrop.io.text_file import check_place, write_whole
from multidrop.points import PointDescription, Role
from multidrop.profile import Profile
from multidrop.tools.profiles.learn import Learning, Moved, described
from multidrop.tools.profiles.text import toml_text, with_points

NAME = re.compile(r"[A-Za-z_]\w*").fullmatch
MOST_SHOWN = 20
"""Points that moved at once; more than that was no single parameter."""


@click.command(epilog="Example: multidrop learn flexmax:0@/dev/ttyUSB0 -o press.toml")
@click.argument("device")
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="NAME.toml",
    help="the profile that learns; it is used if it is there",
)
@common()
def learn(common: Common, device: str, output: str) -> int:
    """Give points of DEVICE their names: change one at the keypad, and see which it is."""
    path = Path(output)
    target = _target(common, device, path)
    if not target.profile.points:
        raise UsageError(
            f"nothing is known of {device} to look at: multidrop discover {device} -o {path} finds points"
        )
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise UsageError("learn asks questions, and nobody is there to answer: it needs a terminal")
    with failure_as_line(str(target.name), common.json), common.connect(target) as connection:
        learning = Learning(connection)
        _say(f"reading {len(learning.points):,} points, twice ...")
        learning.begin()
        if learning.moving:
            _say(f"{len(learning.moving):,} move by themselves and are not looked at")
        learned = 0
        while _asked("\nChange one parameter at the keypad, then press Enter (q ends)") != "q":
            moved = learning.changed()
            learned += sum(_learn(common, learning, item, path) for item in _shown(moved))
    _say(f"{path}: {learned} points learned" if learned else "nothing was learned")
    return 0


def _target(common: Common, device: str, path: Path) -> Target:
    if path.suffix != ".toml":
        raise UsageError(f"{path}: a profile's file ends in .toml")
    target = common.target(device)
    if not path.exists():
        check_place(path)
        target.profile = replace(target.profile, name=path.stem)
        return target
    own = profile_file(path)
    if own.protocol != target.profile.protocol:
        raise UsageError(
            f"{path} is a profile of {own.protocol}, {device} speaks {target.profile.protocol}"
        )
    return Target(target.name, own)


def _shown(moved: list[Moved]) -> list[Moved]:
    """What moved, said; nothing where that tells nothing."""
    if not moved:
        _say("nothing moved: is the parameter in the profile? multidrop discover finds more")
    for item in moved[:MOST_SHOWN]:
        before, after = (with_unit(one.value, one.unit) for one in (item.before, item.after))
        _say(f"  {item.point}   {before} -> {after}")
    if len(moved) > MOST_SHOWN:
        _say(f"  and {len(moved) - MOST_SHOWN:,} more: too many for one parameter")
        return []
    return moved


def _learn(common: Common, learning: Learning, moved: Moved, path: Path) -> bool:
    """Ask for the name of a point, and write it into the profile. Whether it has one now."""
    while True:
        name = _asked(f"Name of {moved.point.text} (Enter leaves it)")
        if not name:
            return False
        if NAME(name) is None:
            _say("a name has letters, digits and underscores, and begins with no digit")
            continue
        unit = _asked(f"Unit (Enter: {moved.point.unit or 'none'})") or moved.point.unit
        known = moved.point.role
        usual = Role.SETTING if known is Role.UNKNOWN else known
        role = click.prompt(
            "Role", default=usual.value, type=click.Choice([item.value for item in Role]), err=True
        )
        point, old = described(moved, name, unit, Role(role))
        try:
            learning.use(_written(learning.connection.target.profile, point, old, path))
        except UsageError as error:
            report_failure(error)
            continue
        _report(common, learning, moved, point)
        return True


def _written(profile: Profile, point: PointDescription, old: str | None, path: Path) -> Profile:
    """The profile with the point, in its file too. Raises `UsageError`, and nothing is written."""
    text = path.read_text(encoding="utf-8") if path.exists() else toml_text(profile)
    places = {} if old is None else {point.name: old}
    text = with_points(text, str(path), {point.name: point}, places)
    found = Profile.from_toml(text, str(path))
    check_points(found, str(path))
    write_whole(text, path)
    return found


def _report(common: Common, learning: Learning, moved: Moved, point: PointDescription) -> None:
    if common.json:
        line = {
            "device": learning.connection.name,
            "point": moved.point.text,
            "name": point.name,
            "before": jsonable(moved.before.value),
            "after": jsonable(moved.after.value),
            "unit": point.unit,
            "role": point.role.value,
        }
        click.echo(json_line(line))
    else:
        click.echo(f"{point.name} is {point.at}")


def _asked(question: str) -> str:
    answer: str = click.prompt(question, default="", show_default=False, err=True)
    return answer.strip()


def _say(text: str) -> None:
    click.echo(text, err=True)
