"""`multidrop read`."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from typing import TypeVar

import click

from multidrop.cli.failures import failure, report_failure
from multidrop.cli.numbers import Seconds
from multidrop.cli.options import Common, common
from multidrop.cli.words import json_line, label, utc, with_unit
from multidrop.errors import Error, PortError, UsageError
from multidrop.io.audit import jsonable
from multidrop.io.connection import Connection, Target
from multidrop.io.readings import in_order, readable
from multidrop.points import Point, Reading

ItemT = TypeVar("ItemT")

RAW_SHOWN = 16
"""Characters of the raw value that a person is shown; --json has all."""

LONG = 10
"""From so many points on, reading them shows its progress."""

LOST = PortError.exit_status
"""Exit status when the port was lost: nothing more will come from it."""


@click.command(
    epilog="Example: multidrop read flexmax:0@/dev/ttyUSB0 8236:int16 actual_speed --every 0.5"
)
@click.argument("device")
@click.argument("points", nargs=-1, metavar="[POINT...]")
@click.option("--all", "everything", is_flag=True, help="every readable point of the profile")
@click.option("--every", type=Seconds(), metavar="S", help="repeat until Ctrl-C")
@common()
def read(
    common: Common, device: str, points: tuple[str, ...], everything: bool, every: float | None
) -> int:
    """Read POINTs of DEVICE."""
    target = common.target(device)
    worked_out = target.device()
    if everything == bool(points):
        raise UsageError("which points? Name them, or --all for every one of the profile")
    if everything:
        asked = list(readable(worked_out))
    else:
        asked = [point for text in points for point in worked_out.points(text)]
    with connected(common, target, asked) as connection:
        started = time.monotonic()
        while True:
            status = read_all(connection, asked, common.json, device)
            if every is None or status == LOST:
                return status
            started += every
            time.sleep(max(0.0, started - time.monotonic()))


def connected(common: Common, target: Target, points: Sequence[Point]) -> Connection:
    """The device on its open line; where that cannot be opened, each point has failed."""
    try:
        return common.connect(target)
    except PortError as error:
        for point in points if common.json else ():
            click.echo(_failed(str(target.name), point, error))
        raise


def read_all(connection: Connection, points: Sequence[Point], as_json: bool, device: str) -> int:
    """All are tried; the highest status counts. A port that is lost stays lost: `LOST`."""
    status = 0
    fault = False
    for point, found in with_progress(in_order(connection, points), len(points)):
        if not isinstance(found, Error):
            fault = fault or bool(found.fault)
            click.echo(as_line(connection.name, found) if as_json else as_text(found))
            continue
        if as_json:
            click.echo(_failed(connection.name, point, found))
        else:
            report_failure(found, str(point))
            if isinstance(found, PortError):
                return max(status, LOST)
        status = max(status, found.exit_status)
    if fault and not as_json:
        click.secho(f"the device is in fault: multidrop status {device}", err=True, fg="yellow")
    return status


def with_progress(items: Iterator[ItemT], count: int) -> Iterator[ItemT]:
    """The same items, with a progress bar on standard error where that is long and a terminal."""
    if count < LONG or not sys.stderr.isatty() or sys.stdout.isatty():
        yield from items
        return
    with click.progressbar(items, length=count, label="reading", file=sys.stderr) as bar:
        yield from bar


def _failed(device: str, point: Point, error: Error) -> str:
    return json_line({"device": device, "point": point.text, "error": failure(error)})


def as_line(device: str, reading: Reading) -> str:
    """A reading as a JSON line."""
    return json_line(
        {
            "device": device,
            "point": reading.point,
            "name": reading.name,
            "value": jsonable(reading.value),
            "unit": reading.unit,
            "type": reading.type,
            "raw": reading.raw_text,
            "fault": reading.fault,
            "time": utc(reading.time),
            "ms": reading.ms,
        }
    )


def as_text(reading: Reading) -> str:
    """A reading for a person."""
    where = label(reading.name, reading.point)
    value = with_unit(reading.value, reading.unit)
    raw = reading.raw_text.upper()
    if len(raw) > RAW_SHOWN:
        raw = raw[: RAW_SHOWN - 3] + "..."
    meaning = f"   {reading.meaning}" if reading.meaning else ""
    return f"{where:<32} {value:>14}   {reading.type:<8} {raw:<{RAW_SHOWN}} {reading.ms:>5.1f} ms{meaning}"
