"""`multidrop write`."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import click

from multidrop.cli.failures import failure, report_failure
from multidrop.cli.options import Common, common
from multidrop.cli.words import json_line, utc, with_unit
from multidrop.device import Device, Write
from multidrop.errors import Error, PortError, UsageError
from multidrop.io.audit import jsonable, shown
from multidrop.io.connection import Connection, keeping
from multidrop.points import Role, shown_value
from multidrop.writing import Outcome, Written


@click.command(
    epilog="Example: multidrop write flexmax:0@/dev/ttyUSB0 8236:int16=1234. A write is sent "
    "once and read back; what cannot be confirmed is never reported as done."
)
@click.argument("device")
@click.argument("assignments", nargs=-1, required=True, metavar="POINT=VALUE...")
@click.option("--no-verify", is_flag=True, help="do not read back: the device's OK is enough")
@click.option("--nv", is_flag=True, help="write the non-volatile value too, where a device has one")
@click.option("--keep-going", is_flag=True, help="go on after a write that was not confirmed")
@common(force="write past limits, read-only marks and a missing audit log", writes=True)
def write(
    common: Common,
    device: str,
    assignments: tuple[str, ...],
    no_verify: bool,
    nv: bool,
    keep_going: bool,
) -> int:
    """Write each POINT=VALUE of DEVICE in the order given, and read it back."""
    target = common.target(device)
    worked_out = target.device()
    if nv:
        keeping(worked_out)
    writes = [_prepared(worked_out, text, nv=nv, force=common.force) for text in assignments]
    common.audit().check()
    _confirm(common, device, writes)
    try:
        connection = common.connect(target)
    except PortError as error:
        for item in writes if common.json else ():
            record = Written(item.point, item.value, Outcome.NOT_SENT, error=error)
            click.echo(json_line(facts(str(target.name), record)))
        raise
    with connection:
        return _write_all(connection, writes, common.json, not no_verify, keep_going)


def _prepared(device: Device, text: str, *, nv: bool, force: bool) -> Write:
    """`POINT=VALUE`, checked. Raises `UsageError`, which names the point: it may be one of many."""
    point, value = parse_assignment(text)
    try:
        return device.prepare_write(f"{point}@nv" if nv else point, value, force=force)
    except UsageError as error:
        raise (error if point in str(error) else UsageError(f"{point}: {error}")) from None


def parse_assignment(text: str) -> tuple[str, str]:
    """`POINT=VALUE`. Raises `UsageError`."""
    point, equals, value = text.partition("=")
    if not equals or not point:
        raise UsageError(f"{text!r} is not POINT=VALUE, as in 8236:int16=1234")
    return point.strip(), value


def _confirm(common: Common, device: str, writes: list[Write]) -> None:
    """What may move something is asked about. What no profile explains may be a command too."""
    moving, unexplained = (_of_role(writes, role) for role in (Role.COMMAND, Role.UNKNOWN))
    parts = []
    if moving:
        parts.append(f"{moving} may start, stop or switch {device}")
    if unexplained:
        parts.append(f"no profile says what {unexplained} does: it may move {device}")
    if parts:
        common.confirm(f"{'; '.join(parts)}. Write it?", needs_yes=bool(moving))


def _of_role(writes: list[Write], role: Role) -> str:
    return ", ".join(
        f"{write.point}={shown_value(write.value)}" for write in writes if write.point.role is role
    )


def _write_all(
    connection: Connection, writes: list[Write], as_json: bool, verify: bool, keep_going: bool
) -> int:
    status = 0
    stopped = False
    for write in writes:
        if stopped:
            record = Written(write.point, write.value, Outcome.NOT_SENT)
        else:
            try:
                connection.audit.check()
                record = connection.carry_out(write, verify=verify)
            except Error as error:  # nothing was sent
                record = Written(write.point, write.value, Outcome.NOT_SENT, error=error)
        if record.error is not None:
            status = max(status, record.error.exit_status)
            stopped = not keep_going or _broke_off(record.error)
        if as_json:
            click.echo(json_line(facts(connection.name, record)))
        else:
            show_record(record)
    return status


def _broke_off(error: Error) -> bool:
    """Whether the port or the patience of whoever waited came to its end."""
    return any(isinstance(why, PortError | KeyboardInterrupt) for why in (error, error.__cause__))


def facts(device: str, record: Written) -> dict[str, Any]:
    """What is known of a write, for a JSON line."""
    description = record.point.description
    line: dict[str, Any] = {
        "device": device,
        "point": record.point.text,
        "name": record.point.name,
        "old": shown(record.old, description),
        "asked": jsonable(record.asked),
        "found": shown(record.found, description),
        "raw": record.point.raw_text(record.found.raw) if record.found else None,
        "outcome": record.outcome.value,
        "time": utc(datetime.now(UTC)),
    }
    if record.error is not None:
        line["error"] = failure(record.error)
    elif record.outcome is Outcome.NOT_SENT:
        line["error"] = {"kind": "not-sent", "text": "an earlier write was not confirmed"}
    return line


def show_record(record: Written) -> None:
    point = record.point
    old = None if record.old is None else shown_value(point.physical(record.old.value))
    if record.error is None and record.outcome is not Outcome.NOT_SENT:
        found = record.asked if record.found is None else point.physical(record.found.value)
        known = "?" if old is None else old
        shown_found = with_unit(found, point.unit)
        click.echo(f"{point!s:<32} {known} -> {shown_found}   {record.outcome.value}")
        return
    unsure = old is not None and record.outcome is Outcome.UNKNOWN
    asked = with_unit("?" if unsure else record.asked, point.unit)
    change = asked if old is None else f"{old} -> {asked}"
    click.echo(f"{point!s:<32} {change}   {record.outcome.value}")
    if record.error is not None:
        report_failure(record.error, str(point))
