"""`multidrop watch`."""

from __future__ import annotations

import time

import click

from multidrop.cli.live import LiveTable, Row
from multidrop.cli.numbers import Seconds
from multidrop.cli.options import Common, common
from multidrop.cli.reading import LOST, connected, read_all
from multidrop.errors import Error, PortError, UsageError
from multidrop.io.connection import Connection
from multidrop.io.readings import in_order
from multidrop.points import Point


@click.command(epilog="Example: multidrop watch flexmax:0@/dev/ttyUSB0 actual_speed 8236:int16")
@click.argument("device")
@click.argument("points", nargs=-1, metavar="[POINT...]")
@click.option("--every", type=Seconds(), default=0.5, metavar="S", help="s between readings (0.5)")
@common()
def watch(common: Common, device: str, points: tuple[str, ...], every: float) -> int:
    """Show POINTs of DEVICE live with their trend, until Ctrl-C.

    A device of the plant file is shown with all its points if none is named.
    """
    target = common.target(device)
    if not points:
        plant_device = common.plant_device(device)
        points = tuple(plant_device.every) if plant_device is not None else ()
        if not points:
            raise UsageError(
                "which points? As in: multidrop watch flexmax:0@/dev/ttyUSB0 actual_speed"
            )
    worked_out = target.device()
    asked = [point for text in points for point in worked_out.points(text)]
    rows = [Row(str(point), point.unit or "") for point in asked]
    with connected(common, target, asked) as connection:
        if common.json:
            return _watch_json(connection, asked, every)
        with LiveTable(device, rows) as table:
            _watch(connection, asked, rows, table, every)
    return 0


def _watch(
    connection: Connection, points: list[Point], rows: list[Row], table: LiveTable, every: float
) -> None:
    due = time.monotonic()
    while True:
        for row, (_, found) in zip(rows, in_order(connection, points), strict=True):
            if isinstance(found, PortError):
                raise found
            if isinstance(found, Error):
                changed = row.fail(str(found))
            else:
                note = "in fault" if found.fault else ""
                changed = row.show(found.value, note, bad=bool(found.fault))
            if changed:
                table.changed(row)
        table.refresh()
        due = max(due + every, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))


def _watch_json(connection: Connection, points: list[Point], every: float) -> int:
    while read_all(connection, points, True, connection.name) != LOST:
        time.sleep(every)
    return LOST
