"""`multidrop broadcast`."""

from __future__ import annotations

from typing import Any

import click

from multidrop.cli.failures import failure_as_line, report_failure
from multidrop.cli.options import Common, common
from multidrop.cli.words import json_line
from multidrop.cli.writing import facts, parse_assignment
from multidrop.conversation import Conversation
from multidrop.device import Received
from multidrop.errors import OutcomeUnknown, PortError, UsageError
from multidrop.io.connection import Target
from multidrop.io.line import Line
from multidrop.io.ports import open_port
from multidrop.numerals import whole_number
from multidrop.points import Role


@click.command(
    epilog="Example: multidrop broadcast flexmax@/dev/ttyUSB0 8236:int16=0 --verify 0,1,2"
)
@click.argument("line")
@click.argument("assignments", nargs=-1, required=True, metavar="POINT=VALUE...")
@click.option(
    "--verify", required=True, metavar="ADDRESSES", help="slaves to ask afterwards: 0,1,2"
)
@click.option("--keep-going", is_flag=True, help="broadcast though a slave is silent")
@common(force="broadcast points of role command and communication too", writes=True)
def broadcast(
    common: Common, line: str, assignments: tuple[str, ...], verify: str, keep_going: bool
) -> int:
    """Write each POINT=VALUE of every slave on LINE (PROFILE@PORT), then ask each of them."""
    target = common.target(line, broadcast=True)
    addresses = _addresses(verify)
    points = [parse_assignment(text) for text in assignments]
    converse = target.protocol.prepare_broadcast(
        target.profile,
        points,
        addresses,
        target.options.own,
        force=common.force,
        keep_going=keep_going,
    )
    audit = common.audit()
    audit.check()
    speaker = target.protocol.device(0, target.profile, target.options.own)
    common.confirm(
        f"Write {', '.join(assignments)} of every slave on {target.port}?",
        needs_yes=any(speaker.point(text).role is Role.COMMAND for text, _ in points),
    )
    with failure_as_line(str(target.name), common.json), _open(target, common) as wire:
        try:
            found = _broadcast(wire, converse())
        except BaseException:
            if wire.acted:
                audit.append(str(target.name), " ".join(assignments), outcome="unknown")
            raise
    for slave in found:
        for record in slave.written:
            audit.written(_name(target, slave), record)
        _show(target, slave, common.json)
    return max((_status(slave) for slave in found), default=0)


def _broadcast(wire: Line, conversation: Conversation[Any, list[Received]]) -> list[Received]:
    """Carry it out; a line or a caller that is lost once it went out leaves the outcome open."""
    try:
        return wire.run(conversation)
    except (KeyboardInterrupt, PortError) as why:
        if not wire.acted:
            raise
        reason = str(why) or "interrupted"
        raise OutcomeUnknown(f"the broadcast went out, then: {reason}", step=reason) from why


def _addresses(text: str) -> list[int]:
    try:
        return [whole_number(word) for word in text.split(",")]
    except ValueError:
        raise UsageError(f"--verify {text!r} is not a list of addresses, as in 0,1,2") from None


def _open(target: Target, common: Common) -> Line:
    line = Line(open_port(target.port, target.setup()), target.settings, target.options)
    common.watch(line, target)
    return line


def _status(slave: Received) -> int:
    errors = [record.error.exit_status for record in slave.written if record.error is not None]
    return max(errors, default=0)


def _name(target: Target, slave: Received) -> str:
    return f"{target.name.profile}:{slave.address}@{target.port}"


def _show(target: Target, slave: Received, as_json: bool) -> None:
    name = _name(target, slave)
    if as_json:
        seen = {"received": slave.received, "applied": slave.applied}
        for record in slave.written:
            click.echo(json_line({**facts(name, record), **seen}))
        return
    words = {True: "yes", False: "NO", None: "unknown"}
    note = f"   ({slave.note})" if slave.note else ""
    click.echo(
        f"{slave.address:>3}   received {words[slave.received]:<8} applied {words[slave.applied]}{note}"
    )
    for record in slave.written:
        if record.error is not None:
            report_failure(record.error)
