"""`multidrop status`, `clear-faults`, `reset-comm`, `raw`."""

from __future__ import annotations

from collections.abc import Callable

import click

from multidrop.cli.failures import failure_as_line
from multidrop.cli.options import Common, common
from multidrop.cli.words import json_line
from multidrop.device import Report
from multidrop.errors import DeviceError
from multidrop.io.connection import Connection, Target, acting


@click.command(epilog="Example: multidrop status flexmax:0@/dev/ttyUSB0")
@click.argument("device")
@common()
def status(common: Common, device: str) -> None:
    """Show state, fault bit, malfunction code and status word of DEVICE by name."""
    target = common.target(device)
    target.device().status()
    _served(common, target, Connection.status)


@click.command(epilog="Example: multidrop clear-faults flexmax:0@/dev/ttyUSB0")
@click.argument("device")
@common(force="go on without an audit log", writes=True)
def clear_faults(common: Common, device: str) -> None:
    """Clear the fault of DEVICE. A FlexMax that is not in fault is left alone."""
    target = common.target(device)
    target.device().clear_faults()
    common.confirm(f"Clear the fault of {device}?", needs_yes=False)
    _served(common, target, Connection.clear_faults)


@click.command(epilog="Example: multidrop reset-comm flexmax:0@/dev/ttyUSB0")
@click.argument("device")
@common(force="go on without an audit log", writes=True)
def reset_comm(common: Common, device: str) -> None:
    """Reset the serial interface of DEVICE. Its faults stay: see clear-faults."""
    target = common.target(device)
    target.device().reset_comm()
    common.confirm(f"Reset the serial interface of {device}?", needs_yes=False)
    _served(common, target, Connection.reset_comm)


@click.command(
    epilog="Example: multidrop raw flexmax:0@/dev/ttyUSB0 23 00 (SLINK3: COMMAND low, COMMAND "
    "high, DATA; dgfc/CDAB1122 goes to the card behind a drive). Datalink: E0 09 00 10 (CMD, NUM, LO ADD, "
    "HI ADD, data). Ultra3000: 0730 (parameter, function, data)"
)
@click.argument("device")
@click.argument("body", nargs=-1, required=True, metavar="HEX...")
@common(force="go on without an audit log", writes=True)
def raw(common: Common, device: str, body: tuple[str, ...]) -> int:
    """Send one command body to DEVICE as is, once, and show the reply."""
    target = common.target(device)
    text = " ".join(body)
    target.device().prepare_raw(text)
    common.confirm(f"Send {text} to {device}? It may move the machine.", needs_yes=False)
    report = _served(common, target, lambda connection: connection.raw(text))
    return DeviceError.exit_status if report.refused else 0  # it was shown


@click.command(epilog="Example: multidrop action ultra3000:0@/dev/ttyUSB0 define_home")
@click.argument("device")
@click.argument("name", required=False)
@common(force="go on without an audit log", writes=True)
def action(common: Common, device: str, name: str | None) -> None:
    """Let DEVICE do something at once, by NAME; without NAME, list what it can do."""
    target = common.target(device)
    worked_out = acting(target.device())
    if name is None:
        for known, meaning in worked_out.actions.items():
            found = Report({"action": known, "meaning": meaning}, (f"{known:<20} {meaning}",))
            _show(common, str(target.name), found)
        return
    worked_out.prepare_action(name)
    common.confirm(f"{name} of {device} may move or change the machine. Do it?", needs_yes=True)
    _served(common, target, lambda connection: connection.act(name))


def _served(common: Common, target: Target, ask: Callable[[Connection], Report]) -> Report:
    """What the device answered, shown; what went wrong instead is a JSON line too."""
    with failure_as_line(str(target.name), common.json), common.connect(target) as connection:
        report = ask(connection)
    _show(common, str(target.name), report)
    return report


def _show(common: Common, device: str, report: Report) -> None:
    if common.json:
        click.echo(json_line({"device": device, **report.fields}))
        return
    for line in report.lines:
        click.echo(line)
