"""`multidrop doctor`."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from multidrop.cli import flags
from multidrop.cli.failures import failure_as_line
from multidrop.cli.listening import find_plant, protocol_name
from multidrop.cli.numbers import Number, Whole
from multidrop.cli.scan_taps import RoundTaps
from multidrop.cli.words import json_line
from multidrop.errors import UsageError
from multidrop.io.connection import Target
from multidrop.io.text_file import check_place
from multidrop.naming import LineOptions, parse_port
from multidrop.plantfile import Plant
from multidrop.protocols import PROTOCOLS
from multidrop.tools.doctor.asking import TIMES
from multidrop.tools.doctor.doctor import judge
from multidrop.tools.doctor.examination import Examination, Visit
from multidrop.tools.doctor.report import is_report, lines_of, report
from multidrop.tools.doctor.verdicts import Verdict, status_of
from multidrop.tools.scan.plan import parse_addresses

if TYPE_CHECKING:
    from multidrop.tools.doctor.doctor import Case

SECONDS, LISTEN_SECONDS = 2.0, 10.0
"""s that are listened for: before something is asked, and where nothing shall be."""
_KEYS = ("baud", "format", "timeout", "silence", "rts", "dtr", "direction")
_OWN = {key: text for protocol in PROTOCOLS.values() for key, text in protocol.options.items()}


_line_keys = partial(flags.line_keys, keys=_KEYS)


@click.command(
    epilog="Example: multidrop doctor /dev/ttyUSB0 --protocol slink3 --addresses 0..3 "
    "- or: multidrop doctor flexmax:0@/dev/ttyUSB0 --report line.txt"
)
@click.argument("where", metavar="PORT[,key=value]... | DEVICE...", nargs=-1, required=True)
@click.option("--protocol", metavar="P", help="slink3, datalink or ultra3000; else all, in turn")
@click.option("--addresses", metavar="0..31", help="ask only these, as in 0..31 or 0,2,7..9")
@click.option("--listen-only", is_flag=True, help="never send a byte")
@click.option("--seconds", type=Number(), metavar="S", help="listen for so long (2; 10 alone)")
@click.option("--times", type=Whole(), default=TIMES, metavar="N", help=f"reads of each ({TIMES})")
@click.option("--report", "file", metavar="FILE", help="every byte with its time, to send in")
@flags.config
@flags.as_json
@flags.trace
@flags.capture
@_line_keys
def doctor(where: tuple[str, ...], file: str | None, json: bool, trace: bool, **given: Any) -> int:
    """Say why a line fails, with the bytes that prove it. Only reads are sent.

    Listens first: where a master speaks, nothing is sent. PORT may be the name of a
    line in the plant file, DEVICE a name there or PROFILE:ADDRESS@PORT; several
    devices are on one port.
    """
    plan = _plan(where, given)
    seconds = given["seconds"]
    if seconds is None:
        seconds = LISTEN_SECONDS if given["listen_only"] else SECONDS
    if not 0 <= seconds <= 86400:
        raise UsageError(f"seconds={seconds:g} is out of range: 0..86400")
    if not 1 <= given["times"] <= 10000:
        raise UsageError(f"times={given['times']} is out of range: 1..10000")
    if file is not None:
        _check_report(Path(file))
    taps = RoundTaps(plan.port, trace=trace, capture=given["capture"])
    with (
        failure_as_line(plan.port, json, of="port"),
        contextlib.closing(taps),
        _progress(quiet=trace) as tell,
    ):
        case = Examination(
            *(plan.port, plan.options, plan.visits),
            seconds=seconds,
            listen_only=given["listen_only"],
            times=given["times"],
            watch=taps,
            tell=tell,
        ).run()
        verdicts = judge(case)
    with contextlib.suppress(BrokenPipeError):  # the status tells it too
        _show(plan.port, verdicts, json)
    if file is not None:
        _write(file, case, verdicts)
    return status_of(verdicts)


# -- what is asked for -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Plan:
    """A port, how it is opened, and whom to ask there."""

    port: str
    options: LineOptions
    visits: tuple[Visit, ...]


def _plan(where: tuple[str, ...], given: dict[str, Any]) -> _Plan:
    """Raises `UsageError`."""
    keys = flags.taken_keys(given)
    targets = _targets(where, given["config"], keys)
    if targets:
        return _of_devices(targets, given)
    if len(where) > 1:
        raise UsageError("one port at a time: several names are for several devices of one port")
    port, pairs = parse_port(where[0])
    options = LineOptions.parse({**pairs, **keys}, _OWN)
    names = [name] if (name := protocol_name(given["protocol"])) else list(PROTOCOLS)
    visits = [visit for name in names if (visit := _visit(name, options, given["addresses"]))]
    if not visits:
        raise UsageError("none of these addresses exists in these protocols")
    return _Plan(port, options, tuple(visits))


def _visit(name: str, options: LineOptions, addresses: str | None) -> Visit | None:
    """All addresses of a protocol, or those of them that were asked for."""
    protocol = PROTOCOLS[name]
    wanted = parse_addresses(addresses) if addresses else protocol.prober.addresses
    known = tuple(address for address in wanted if address in protocol.prober.addresses)
    own = {key: text for key, text in options.own.items() if key in protocol.options}
    settings = protocol.line_for(own).with_options(**options.line_settings())
    return Visit(protocol, settings, known) if known else None


def _targets(where: tuple[str, ...], config: str | None, keys: dict[str, str]) -> list[Target]:
    """The devices that are named, by their addresses or in the plant file; none for a port."""
    plant = find_plant(config)
    targets = []
    for name in where:
        if "@" in name:
            found = [Target.of(name)]
        else:
            found = _planned(plant, name) if plant is not None else []
        if not found:
            return []
        targets += found
    return [
        Target(replace(target.name, options={**target.name.options, **keys}), target.profile)
        for target in targets
    ]


def _planned(plant: Plant, name: str) -> list[Target]:
    """A device of the plant, or all those of a line."""
    return [
        Target(item.device, item.profile)
        for item in plant.devices.values()
        if name in (item.name, item.line)
    ]


def _of_devices(targets: list[Target], given: dict[str, Any]) -> _Plan:
    first = targets[0]
    for target in targets:
        same = (target.port, target.protocol.name) == (first.port, first.protocol.name)
        if not same or target.settings.baud != first.settings.baud:
            raise UsageError(f"{target.name} is not on the line of {first.name}")
    if given["protocol"] not in (None, first.protocol.name):
        raise UsageError(f"{first.name} speaks {first.protocol.name}, not {given['protocol']}")
    addresses = tuple(
        sorted({item.name.address for item in targets if item.name.address is not None})
    )
    if given["addresses"]:
        addresses = parse_addresses(given["addresses"])
    return _Plan(first.port, first.options, (Visit(first.protocol, first.settings, addresses),))


# -- while it goes on ------------------------------------------------------------------------


@contextmanager
def _progress(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Says what is being done where standard error is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda text: None
        return
    from rich.console import Console

    with Console(stderr=True).status("listening") as status:
        yield status.update


def _check_report(path: Path) -> None:
    """Before anything is sent: a report replaces an older one, and nothing else. Raises `UsageError`."""
    check_place(path, force=True)
    if path.exists() and not os.access(path, os.W_OK):  # of its folder it is known by now
        raise UsageError(f"{path} cannot be written: {os.strerror(errno.EACCES)}")
    if path.is_file() and path.stat().st_size and not is_report(path):
        raise UsageError(f"{path} is there and no report of the doctor; it is not replaced")


def _write(file: str, case: Case, verdicts: list[Verdict]) -> None:
    when = datetime.now(UTC).isoformat(timespec="seconds")
    Path(file).write_text(report(case, verdicts, version("multidrop"), when), encoding="utf-8")
    click.echo(f"every byte is in {file}", err=True)


def _show(port: str, verdicts: list[Verdict], json: bool) -> None:
    for verdict in verdicts:
        if json:
            click.echo(json_line({"port": port, **verdict.fields(), "status": verdict.status}))
            continue
        head, *rest = lines_of(verdict)
        click.secho(head, bold=True, fg="red" if verdict.status else None)
        for line in rest:
            click.echo(line)
