"""`multidrop save`, `load`, `compare-memory`: working, saved and default values of a device."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import click

from multidrop.cli.failures import failure, failure_as_line, report_failure
from multidrop.cli.options import Common, common
from multidrop.cli.reading import with_progress
from multidrop.cli.words import json_line
from multidrop.cli.writing import facts, show_record
from multidrop.device import Copy, Memory
from multidrop.errors import Error, PortError
from multidrop.io.audit import shown
from multidrop.io.connection import Connection, keeping
from multidrop.points import Point, Role, Sample, shown_value


@click.command(epilog="Example: multidrop save ultra3000:0@/dev/ttyUSB0 kp ki")
@click.argument("device")
@click.argument("points", nargs=-1, required=True, metavar="POINT...")
@common(force="save what the profile advises against", writes=True)
def save(common: Common, device: str, points: tuple[str, ...]) -> int:
    """Copy the working values of POINTs into the non-volatile memory of DEVICE."""
    return _copy_all(common, device, points, save=True)


@click.command(epilog="Example: multidrop load ultra3000:0@/dev/ttyUSB0 kp")
@click.argument("device")
@click.argument("points", nargs=-1, required=True, metavar="POINT...")
@common(force="load what the profile advises against", writes=True)
def load(common: Common, device: str, points: tuple[str, ...]) -> int:
    """Copy the non-volatile values of POINTs of DEVICE back into use."""
    return _copy_all(common, device, points, save=False)


def _copy_all(common: Common, device: str, points: tuple[str, ...], *, save: bool) -> int:
    target = common.target(device)
    worked_out = keeping(target.device())
    copies = [worked_out.prepare_copy(text, save=save, force=common.force) for text in points]
    common.audit().check()
    moving = [str(copy.point) for copy in copies if copy.point.role is Role.COMMAND]
    if moving:
        common.confirm(f"{', '.join(moving)} may move {device}. Do it?", needs_yes=True)
    with failure_as_line(str(target.name), common.json), common.connect(target) as connection:
        return _carry_out(connection, copies, common.json)


def _carry_out(connection: Connection, copies: Sequence[Copy], as_json: bool) -> int:
    """In the order given; stops at the first that is not confirmed."""
    for copy in copies:
        records = connection.copy(copy)
        for record in records:
            if as_json:
                click.echo(json_line(facts(connection.name, record)))
            else:
                show_record(record)
        status = max((item.error.exit_status for item in records if item.error), default=0)
        if status:
            return status
    return 0


@click.command(
    "compare-memory", epilog="Example: multidrop compare-memory ultra3000:0@/dev/ttyUSB0"
)
@click.argument("device")
@click.option("--all", "everything", is_flag=True, help="show the points that are the same too")
@common()
def compare_memory(common: Common, device: str, everything: bool) -> int:
    """Show what of DEVICE was changed and not saved, and what was saved and is not the default."""
    target = common.target(device)
    points = keeping(target.device()).comparable()
    status = 0
    found: list[Memory] = []
    with failure_as_line(str(target.name), common.json), common.connect(target) as connection:
        for point, memory in with_progress(_compared(connection, points), len(points)):
            if isinstance(memory, Error):
                status = max(status, memory.exit_status)
                if common.json:
                    line = {"device": connection.name, "point": point.text}
                    click.echo(json_line({**line, "error": failure(memory)}))
                else:
                    report_failure(memory, str(point))
                if isinstance(memory, PortError):
                    return status
            elif everything or memory.unsaved or memory.customised:
                found.append(memory)
                if common.json:
                    click.echo(_as_line(connection.name, memory))
    if not common.json:
        _show(found, len(points))
    return status


def _compared(
    connection: Connection, points: Sequence[Point]
) -> Iterator[tuple[Point, Memory | Error]]:
    device = keeping(connection.device)
    for point in points:
        try:
            yield point, connection.line.run(device.compare(point))
        except Error as error:
            yield point, error
            if isinstance(error, PortError):
                return


def _as_line(device: str, memory: Memory) -> str:
    point = memory.point
    return json_line(
        {
            "device": device,
            "point": point.text,
            "name": point.name,
            "working": shown(memory.working, point.description),
            "saved": shown(memory.saved, point.description),
            "default": shown(memory.default, point.description),
            "unit": point.unit,
            "unsaved": memory.unsaved,
            "customised": memory.customised,
        }
    )


def _show(found: Sequence[Memory], compared: int) -> None:
    from multidrop.cli.about import print_table

    rows = [
        (
            str(memory.point),
            _text(memory.working, memory),
            _text(memory.saved, memory),
            _text(memory.default, memory),
            memory.point.unit or "",
            "changed, not saved"
            if memory.unsaved
            else "saved, not the default"
            if memory.customised
            else "",
        )
        for memory in found
    ]
    print_table(("point", "working", "saved", "default", "unit", ""), rows)
    unsaved = sum(memory.unsaved for memory in found)
    customised = sum(memory.customised for memory in found)
    click.echo(
        f"{compared} points: {unsaved} changed and not saved, {customised} saved and not the default"
    )


def _text(sample: Sample | None, memory: Memory) -> str:
    return "" if sample is None else shown_value(memory.point.physical(sample.value))
