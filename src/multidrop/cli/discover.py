"""`multidrop discover`."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import click

from multidrop.cli.failures import INTERRUPTED, failure_as_line
from multidrop.cli.options import Common, common
from multidrop.cli.words import duration, json_line
from multidrop.errors import Error, UsageError
from multidrop.io.audit import jsonable
from multidrop.io.connection import Connection
from multidrop.io.text_file import check_place, write_whole
from multidrop.naming import DeviceName, parse_simulated
from multidrop.points import PointDescription
from multidrop.profile import Profile
from multidrop.tools.profiles.discover import Discovery
from multidrop.tools.profiles.discovery_state import State
from multidrop.tools.profiles.heard_points import heard
from multidrop.tools.profiles.text import toml_text


@click.command(
    epilog="Example: multidrop discover flexmax:0@/dev/ttyUSB0 8000..9999 -o press.toml; "
    "multidrop discover ax-v:2 --from line.pcapng -o winder.toml"
)
@click.argument("device")
@click.argument("where", metavar="[RANGE]", required=False)
@click.option("-o", "--output", required=True, metavar="NAME.toml", help="the profile")
@click.option(
    "--from",
    "capture_file",
    metavar="CAPTURE",
    help="no device: what was read and written in a capture",
)
@click.option("--resume", is_flag=True, help="go on where an earlier call was interrupted")
@common(force="replace NAME.toml, and begin anew where an earlier call was interrupted")
def discover(
    common: Common,
    device: str,
    where: str | None,
    output: str,
    capture_file: str | None,
    resume: bool,
) -> int:
    """Find out which points DEVICE has, by reading; the result is a profile.

    RANGE is FIRST..LAST of indices (slink3; 8236.0..15 of subindices, std/FIRST..LAST
    of standard parameters), 0xFIRST..0xLAST of parameters (ultra3000) or addresses
    of memory (datalink); everything without it.
    """
    path = Path(output)
    if path.suffix != ".toml":
        raise UsageError(f"{output}: a profile's file ends in .toml")
    check_place(path, force=common.force)
    if capture_file is not None:
        if where is not None or resume:
            raise UsageError("--from looks at all of a capture: no RANGE, no --resume")
        return _from_capture(common, device, capture_file, path)
    target = common.target(device)
    head = {"device": str(target.name), "profile": target.profile.name, "range": where}
    unfinished = path.with_name(f"{path.name}.unfinished")
    if common.force and not resume:
        unfinished.unlink(missing_ok=True)
    with (
        failure_as_line(str(target.name), common.json),
        common.connect(target) as connection,
        State(unfinished, head, resume=resume) as state,
    ):
        try:
            run = Discovery(connection, where, found=state.found, note=state.add)
            _run(common, run)
        except (KeyboardInterrupt, Error) as why:
            return _broken_off(state, why)
        write_whole(toml_text(run.profile(path.stem), _comment(connection)), path)
        state.remove()
        _report(common, run, path)
    return 0


def _from_capture(common: Common, device: str, file: str, path: Path) -> int:
    name, profile = _named(common, device)
    found = heard(file, name, profile)
    for note in found.notes:
        click.secho(f"{file}: {note}", err=True, fg="yellow")
    text = toml_text(found.profile(path.stem, Path(file).name), f"Heard in {Path(file).name}")
    write_whole(text, path)
    for item in found.points:
        point = item.description
        if common.json:
            line = {"point": point.at, "name": point.name, "type": item.type}
            facts = {"reads": item.reads, "writes": item.writes, "every": item.every}
            values = [jsonable(value) for value in item.values]
            click.echo(json_line({**line, **facts, "values": values}))
        else:
            click.echo(f"{point.name} ({point.at})   {item.said}")
    click.echo(f"{path}: {len(found.points)} points heard", err=True)
    return 0


def _named(common: Common, device: str) -> tuple[DeviceName, Profile]:
    """`PROFILE:ADDRESS`, with or without a port, or a device of the plant file. Raises `UsageError`."""
    if ":" in device and "@" not in device:
        profile, address, _ = parse_simulated(device)
        name = DeviceName(profile, address, "", {})
        return name, common.profile_of(name)
    target = common.target(device)
    return target.name, target.profile


def _comment(connection: Connection) -> str:
    return f"Found out with reads: multidrop discover {connection.name}"


def _run(common: Common, run: Discovery) -> None:
    places = run.sweep.places
    if not common.json:
        click.echo(f"looking at some of {len(places):,} {run.sweep.what} ...", err=True)
    seconds = run.estimate()
    left = len(run.left)
    if common.json:
        line = {"device": run.connection.name, "places": len(places), "left": left}
        click.echo(json_line({**line, "seconds": round(seconds, 1)}))
        sys.stdout.flush()
    else:
        first, last = run.sweep.where(places[0]), run.sweep.where(places[-1])
        click.echo(
            f"{first} to {last}: "
            + (f"about {duration(seconds)} for the {left:,} that are left" if left else "done"),
            err=True,
        )
    with click.progressbar(
        run.run(), length=left, label="reading", file=sys.stderr, hidden=not sys.stderr.isatty()
    ) as bar:
        for _ in bar:
            pass


def _broken_off(state: State, why: KeyboardInterrupt | Error) -> int:
    """Says how to go on; what was found so far is kept, unless it is nothing."""
    if not state.found:
        state.remove()
        raise why
    click.echo(
        f"{len(state.found):,} places are kept in {state.path}; the same command with --resume goes on",
        err=True,
    )
    if isinstance(why, Error):
        raise why
    return INTERRUPTED


def _report(common: Common, run: Discovery, path: Path) -> None:
    summary = run.summary()
    if common.json:
        line = {"device": run.connection.name, "file": str(path), "looked": summary.looked}
        more = {"found": summary.found, "known": summary.known, "unanswered": summary.unanswered}
        click.echo(json_line({**line, **more}))
        return
    types = Counter(_type_of(run, point) for point in run.points)
    parts = ", ".join(f"{count} {name}" for name, count in types.most_common())
    click.echo(f"{path}: {summary.found} points found" + (f": {parts}" if parts else ""))
    if summary.known:
        known = "all" if summary.known == summary.found else f"{summary.known}"
        click.echo(f"{known} of them are in {run.sweep.profile.name}")
    for place in summary.unanswered[:10]:
        click.echo(f"nothing is known of {place}", err=True)
    if len(summary.unanswered) > 10:
        click.echo(f"and of {len(summary.unanswered) - 10} more", err=True)


def _type_of(run: Discovery, point: PointDescription) -> str:
    return (
        point.type
        or point.at.partition(":")[2]
        or run.connection.device.point(point.at).type
        or "without a type"
    )
