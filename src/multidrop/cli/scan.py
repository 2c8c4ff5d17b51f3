"""`multidrop scan`."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from multidrop.cli import flags
from multidrop.cli.about import print_table
from multidrop.cli.failures import INTERRUPTED, failure_as_line
from multidrop.cli.numbers import Number, Whole
from multidrop.cli.scan_taps import RoundTaps
from multidrop.cli.words import duration, json_line
from multidrop.errors import NoReply, PortError, ProtocolError, UsageError
from multidrop.exchange import LATE
from multidrop.io.text_file import check_place, write_whole
from multidrop.naming import LineOptions
from multidrop.tools.scan.plan import (
    FIXED,
    LISTEN,
    WAIT,
    Round,
    Wanted,
    check_protocols,
    parse_addresses,
)
from multidrop.tools.scan.result import FoundDevice, State, StateFile, Traffic, as_toml
from multidrop.tools.scan.scan import Progress, Scanner

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NOTHING_FOUND = NoReply.exit_status
ANOTHER_MASTER = UsageError.exit_status
"""Nothing was sent."""
BROKE_IN = ProtocolError.exit_status
"""A frame that should not have come."""
FEW_ROUNDS = 4
_PORT_KEYS = ("rts", "dtr", "direction")


_port_keys = partial(flags.line_keys, keys=_PORT_KEYS)


@click.command(
    epilog="Example: multidrop scan /dev/ttyUSB0 -o multidrop.toml "
    "- or, where the protocol is known: multidrop scan COM3 --protocol slink3 --addresses 0..31"
)
@click.argument("port")
@click.option(
    "--protocol", "protocols", multiple=True, metavar="NAME", help="only this one; repeatable"
)
@click.option(
    "--baud", "bauds", multiple=True, type=Whole(), metavar="RATE", help="at this rate; repeatable"
)
@click.option("--format", "formats", multiple=True, metavar="8E1", help="in this one; repeatable")
@click.option("--addresses", metavar="0..31", help="only these, as in 0..31 or 0,2,7..9")
@click.option("--all-settings", is_flag=True, help="all bauds and formats that devices may have")
@click.option(
    "--first", is_flag=True, help="end with the first protocol and setting that is answered"
)
@click.option("--timeout", type=Number(), metavar="S", help=f"s for an answer ({WAIT:g})")
@click.option("--thorough", is_flag=True, help=f"{LATE:g} s for each answer")
@click.option("--listen", type=Number(), default=LISTEN, metavar="S", help=f"s before ({LISTEN:g})")
@click.option("--anyway", is_flag=True, help="speak though another master is there")
@click.option("--resume", is_flag=True, help="go on with a scan that was interrupted")
@click.option("--state", metavar="FILE", help="where a scan is kept until it ends, for --resume")
@click.option("-o", "--output", metavar="FILE", help="write the plant file here, not to the screen")
@click.option("--force", is_flag=True, help="replace FILE")
@flags.as_json
@flags.trace
@flags.capture
@_port_keys
def scan(port: str, output: str | None, json: bool, trace: bool, **given: Any) -> int:
    """Find out which protocol, baud rate, format and addresses answer at PORT. Only reads are sent."""
    url, options = _port(port, given)
    if output is not None:
        check_place(Path(output), force=given["force"])
    kept = StateFile(url, Path(given["state"]) if given["state"] else None)
    state = _state(kept, given, url)
    taps = RoundTaps(url, trace=trace, capture=given["capture"])
    click.get_current_context().call_on_close(taps.close)
    scanner = Scanner(url, options, state, watch=taps)
    _announce(url, scanner, state)
    try:
        with failure_as_line(url, json, of="port"), _progress(scanner, kept, quiet=trace):
            devices = scanner.run()
    except KeyboardInterrupt:
        click.secho("interrupted", err=True, fg="red")
        _broken_off(scanner, kept, port, json)
        return INTERRUPTED
    except PortError:
        if state.left is not None:
            _broken_off(scanner, kept, port, json)
        raise
    if scanner.traffic is not None:
        click.secho(_traffic(scanner.traffic, url), err=True, fg="red")
        if not scanner.traffic.between:
            return ANOTHER_MASTER
        _broken_off(scanner, kept, port, json)
        return BROKE_IN
    kept.remove()
    _show(devices, json)
    known = [item for item in devices if item.profile is not None]
    _write(url, known, output, json)
    _say_what_is_left(url, scanner)
    return 0 if known else NOTHING_FOUND


def _write(url: str, known: list[FoundDevice], output: str | None, json: bool) -> None:
    """The plant file, where somebody answered: nobody is no plant, and replaces none."""
    if output is None:
        if known and not json:
            click.echo(as_toml(url, known), nl=False)
    elif known:
        write_whole(as_toml(url, known), Path(output))
        click.echo(f"written to {output}", err=True)
    else:
        click.echo(f"{output} is not written: there is nothing to write into it", err=True)


# -- what is asked for -----------------------------------------------------------------------


def _port(text: str, given: dict[str, Any]) -> tuple[str, LineOptions]:
    """`PORT[,key=value]...`; keys of the port itself, for the rest is what a scan finds out."""
    url, *pairs = text.split(",")
    keys = dict(pair.partition("=")[::2] for pair in pairs)
    keys |= flags.taken_keys(given)
    for key in keys:
        if key not in _PORT_KEYS:
            raise UsageError(
                f"{text!r}: a port to scan has the keys {' '.join(_PORT_KEYS)}, not {key!r}"
            )
    return url, LineOptions.parse(keys, {})


def _wanted(given: dict[str, Any]) -> Wanted:
    if given["thorough"] and given["timeout"] is not None:
        raise UsageError(f"--thorough is --timeout {LATE:g}: give one of them")
    wait = LATE if given["thorough"] else given["timeout"]
    if wait is not None and not 0.005 <= wait <= 60:
        raise UsageError(f"timeout={wait:g} s is out of range: 0.005..60")
    if not 0 <= given["listen"] <= 3600:
        raise UsageError(f"listen={given['listen']:g} s is out of range: 0..3600")
    return Wanted(
        protocols=check_protocols(given["protocols"]),
        bauds=given["bauds"],
        formats=tuple(text.upper() for text in given["formats"]),
        addresses=parse_addresses(given["addresses"]) if given["addresses"] else (),
        all_settings=given["all_settings"],
        first=given["first"],
        anyway=given["anyway"],
        wait=WAIT if wait is None else wait,
        listen=given["listen"],
    )


def _state(kept: StateFile, given: dict[str, Any], url: str) -> State:
    """A new scan, or the one that was interrupted."""
    wanted = _wanted(given)
    if not given["resume"]:
        if kept.path.exists():
            click.echo(f"an earlier scan of {url} was not finished; this one begins anew", err=True)
        return State(wanted)
    state = kept.load()
    if state is None:
        raise UsageError(f"there is no scan of {url} to go on with ({kept.path})")
    if replace(wanted, anyway=False, listen=LISTEN) != Wanted():
        raise UsageError(
            "--resume goes on with what was asked for then: leave the other options away"
        )
    state.wanted = replace(state.wanted, anyway=wanted.anyway, listen=wanted.listen)
    return state


# -- while it goes on ------------------------------------------------------------------------


def _announce(url: str, scanner: Scanner, state: State) -> None:
    """What will be asked, and how long that takes."""
    left = scanner.rounds[state.number :]
    seconds = state.wanted.listen + sum(item.seconds(state.wanted.wait) for item in left)
    if len(left) <= FEW_ROUNDS:
        what = ", ".join(f"{item} ({_addresses(item)})" for item in left)
    else:
        names = ", ".join(dict.fromkeys(item.protocol for item in left))
        what = f"{names} at {len({(item.baud, item.format) for item in left})} settings"
    again = f" from {scanner.at} on" if state.number or state.left is not None else ""
    click.echo(f"{url}: {what}{again}; about {duration(seconds)}", err=True)


def _addresses(item: Round) -> str:
    count = len(item.addresses)
    return f"address {item.addresses[0]}" if count == 1 else f"{count} addresses"


@contextmanager
def _progress(scanner: Scanner, kept: StateFile, *, quiet: bool) -> Iterator[None]:
    """Keeps the state, and shows how far it is."""
    kept_well = True

    with _bar(quiet=quiet) as show:

        def told(progress: Progress) -> None:
            nonlocal kept_well
            try:
                kept.keep(scanner.state, time.monotonic())
            except OSError as error:
                if kept_well:
                    click.echo(f"{kept.path}: {error.strerror}; --resume will not work", err=True)
                kept_well = False
            show(progress)

        scanner.tell = told
        yield


@contextmanager
def _bar(*, quiet: bool) -> Iterator[Callable[[Progress], None]]:
    """A bar where standard error is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda progress: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("listening", total=None)

        def shown(progress: Progress) -> None:
            found = f", {progress.devices} found" if progress.devices else ""
            bar.update(
                task,
                description=f"{progress.round}{found}",
                total=progress.total,
                completed=progress.asked,
            )

        yield shown


# -- at the end ------------------------------------------------------------------------------


def _broken_off(scanner: Scanner, kept: StateFile, port: str, json: bool) -> None:
    """What was found so far, and how to go on."""
    state = scanner.state
    _show(state.devices, json)
    if state.found:
        addresses = ", ".join(str(address) for address in sorted(state.found))
        click.echo(f"answered at {scanner.rounds[state.number]}: {addresses}", err=True)
    try:
        kept.keep(state)
    except OSError as error:
        click.echo(f"{kept.path}: {error.strerror}; the scan cannot be gone on with", err=True)
        return
    where = f" --state {kept.path}" if kept.named else ""
    click.echo(f"multidrop scan {port} --resume{where}  goes on at {scanner.at}", err=True)


def _traffic(traffic: Traffic, url: str) -> str:
    """Somebody else speaks: what was heard, and what to do."""
    setting = f"{traffic.baud} {traffic.format}"
    if traffic.between:
        return (
            f"another master speaks {traffic.protocol} at {setting}: {traffic.lines[0]}\n"
            "Two masters disturb each other, so the scan ended here. Stop the other one, "
            "or --anyway speaks all the same."
        )
    if traffic.protocol is None:
        what = f"somebody speaks on {url}: {traffic.size} bytes in {traffic.seconds:g} s that make no sense at {setting}"
    else:
        what = f"another master speaks {traffic.protocol} on {url}, at {setting}:"
    lines = [what, *(f"  {line}" for line in traffic.lines)]
    if traffic.addresses:
        lines.append(f"answers came from {', '.join(str(item) for item in traffic.addresses)}")
    lines.append(
        "Nothing was sent. Stop the other master and scan again; --anyway speaks all the same, "
        "and may disturb both."
    )
    return "\n".join(lines)


def _show(devices: list[FoundDevice], json: bool) -> None:
    if json:
        for device in devices:
            click.echo(json_line(_fields(device)))
        return
    rows = [
        (
            f"{device.profile or device.protocol}:{device.address}",
            device.protocol,
            f"{device.baud} {device.format}",
            "" if device.ms is None else f"{device.ms:7.1f} ms",
            device.error or "; ".join(filter(None, (_behind(device), device.note))),
        )
        for device in devices
    ]
    print_table(("device", "protocol", "line", "answers in", ""), rows)


def _behind(device: FoundDevice) -> str:
    return f"{device.behind} behind it" if device.behind else ""


def _fields(device: FoundDevice) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "protocol": device.protocol,
        "profile": device.profile,
        "address": device.address,
        "baud": device.baud,
        "format": device.format,
        "behind": device.behind,
        "ms": device.ms,
        "note": device.note,
    }
    if device.error:
        fields["error"] = {"kind": ProtocolError.kind, "text": device.error}
    return fields


def _say_what_is_left(url: str, scanner: Scanner) -> None:
    """What such a scan cannot find, and how to find it."""
    wanted, counted = scanner.state.wanted, scanner.counted
    lines = []
    if not scanner.state.devices:
        lines.append("nobody answered: check wiring, A and B, termination, the devices' power")
    if counted.echoes:
        lines.append("the line hears itself: its echo is no device, and was left out")
    if counted.strays:
        lines.append(f"{counted.strays} frames came that nobody had asked for; see --trace")
    if counted.noisy:
        lines.append("much damage came that no address explains: a noisy line, or another format")
    if wanted.wait < LATE:
        seconds = sum(item.seconds(LATE) for item in scanner.rounds)
        lines.append(
            f"found are drives that answer within {wanted.wait * 1000:g} ms, and later ones, up to "
            f"{LATE:g} s, unless other bytes met theirs; --thorough: {seconds:.0f} s"
        )
    if url.startswith(FIXED):
        lines.append("baud rate and format are those that the device server is set to")
    elif not wanted.all_settings:
        lines.append("other baud rates and formats: --all-settings, or --baud and --format")
    for line in lines:
        click.echo(line, err=True)
