"""`multidrop backup`, `multidrop diff`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from multidrop.cli.failures import failure_as_line
from multidrop.cli.options import Common, common
from multidrop.cli.words import json_line, label, with_unit
from multidrop.io.audit import jsonable
from multidrop.io.connection import Target
from multidrop.io.text_file import check_place
from multidrop.passports.backup import Backup, load, save
from multidrop.passports.backup import backup as back_up
from multidrop.passports.difference import Difference, differences
from multidrop.passports.passport import Entry, Passport, Unread


@click.command(epilog="Example: multidrop backup ultra3000:0@/dev/ttyUSB0 -o infeed.passport.toml")
@click.argument("device")
@click.option("-o", "--output", required=True, metavar="FILE", help="the passport")
@common(force="replace a file that is no passport, or another device's")
def backup(common: Common, device: str, output: str) -> int:
    """Read every readable point of DEVICE into a passport, a text file."""
    path = Path(output)
    target = common.target(device)
    if not common.force:
        _check_place(path, target)
    check_place(path, force=True)
    with failure_as_line(str(target.name), common.json), common.connect(target) as connection:
        run = Backup.of(connection)
        with click.progressbar(
            run.run(),
            length=len(run.points),
            label="reading",
            file=sys.stderr,
            hidden=not sys.stderr.isatty(),
        ) as bar:
            for _ in bar:
                pass
        made = run.passport()
    save(made, path)
    for unread in () if common.json else made.unreadable.values():
        click.echo(f"not read: {label(unread.name, unread.point)}: {unread.reason}", err=True)
    _report(made, path, as_json=common.json)
    return 0


def _check_place(path: Path, target: Target) -> None:
    """Before a byte is sent: is nothing there but an older passport of the device?"""
    from multidrop.errors import UsageError

    if not path.is_file():
        return
    try:
        there = load(path, damaged=True)
    except UsageError:
        raise UsageError(f"{path} is there and no passport; --force replaces it") from None
    if (there.profile, there.address) != (target.profile.name, target.name.address):
        raise UsageError(f"{path} is a passport of {there.device}; --force replaces it")


def _report(made: Passport, path: Path, *, as_json: bool) -> None:
    if as_json:
        line = {"device": made.device, "file": str(path), "points": len(made.points)}
        click.echo(json_line({**line, "unreadable": len(made.unreadable)}))
    else:
        missing = f", {len(made.unreadable)} could not be read" if made.unreadable else ""
        click.echo(f"{path}: {len(made.points)} points of {made.device}{missing}")


@click.command(
    epilog="Example: multidrop diff infeed.passport.toml ultra3000:0@/dev/ttyUSB0. "
    "Exit status 0: the same, 1: different."
)
@click.argument("before", metavar="A")
@click.argument("after", metavar="B")
@click.option("--all", "everything", is_flag=True, help="compare setpoints and commands too")
@common(force="compare a passport whose checksum is wrong")
def diff(common: Common, before: str, after: str, everything: bool) -> int:
    """Compare two passports, or a passport and a device: A and B are files or devices."""
    found = list(differences(_side(common, before), _side(common, after), everything=everything))
    for item in found:
        click.echo(_as_line(item) if common.json else _as_text(item))
    return 1 if found else 0


def _side(common: Common, text: str) -> Passport:
    path = Path(text)
    if "@" not in text and (path.is_file() or path.suffix):
        return load(path, damaged=common.force)
    target = common.target(text)
    with failure_as_line(str(target.name), common.json), common.connect(target) as connection:
        return back_up(connection)


def _as_text(item: Difference) -> str:
    where = label(item.name, item.point)
    return f"{where:<32} {shown(item.before)} -> {shown(item.after)}"


def shown(side: Entry | Unread | None) -> str:
    """A side of a difference for a person."""
    if side is None:
        return "(not in it)"
    if isinstance(side, Unread):
        return f"(not readable: {side.reason})"
    return with_unit(side.value, side.unit)


def _as_line(item: Difference) -> str:
    def value(side: Entry | Unread | None) -> object:
        return jsonable(side.value) if isinstance(side, Entry) else None

    known = item.before if isinstance(item.before, Entry) else item.after
    line = {
        "point": item.point,
        "name": item.name,
        "before": value(item.before),
        "after": value(item.after),
        "unit": known.unit if isinstance(known, Entry) else None,
    }
    return json_line(line)
