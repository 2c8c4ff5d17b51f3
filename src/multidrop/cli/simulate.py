"""`multidrop simulate`."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click

from multidrop.catalog import load_profile
from multidrop.cli.numbers import Number, Whole
from multidrop.errors import UsageError
from multidrop.io.connection import line_settings
from multidrop.io.listen import Listener
from multidrop.naming import LineOptions, parse_simulated
from multidrop.plantfile import load_plant
from multidrop.profile import Profile
from multidrop.protocols import PROTOCOLS
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import LATE, RandomFaults, parse_fault
from multidrop.sim.line import LineFaults, Pace, SimulatedDevice, SimulatedLine
from multidrop.sim.serve import serve, serve_ears
from multidrop.timing import LineSettings


@click.command(
    epilog="Example: multidrop simulate flexmax:0+dgfc386 ax-v:2 --listen tcp://127.0.0.1:4001 "
    "- then, in another terminal: multidrop read ax-v:2@tcp://127.0.0.1:4001 1009"
)
@click.argument("devices", nargs=-1, metavar="[PLANT.toml | PROFILE:ADDRESS...]")
@click.option("--from", "capture", metavar="FILE", help="devices that answer as in this capture")
@click.option("--listen", metavar="WHERE", help="tcp://127.0.0.1:4001 or pty[:LINK]")
@click.option(
    "--tap", metavar="WHERE", help="where others may listen to the line: tcp://... or pty[:LINK]"
)
@click.option("--pace", is_flag=True, help="every byte takes its time on the line")
@click.option("--baud", type=Whole(), metavar="RATE", help="baud rate of --pace")
@click.option(
    "--burst", type=Number(), default=0.0, metavar="MS", help="deliver in bursts, as adapters do"
)
@click.option(
    "--delay", type=Number(), default=0.0, metavar="MS", help="from a request to its answer"
)
@click.option("--fault", "faults", multiple=True, metavar="NAME=RATE", help="such as no-answer=5%")
@click.option(
    "--late", type=Number(), default=LATE, metavar="S", help="how late a late answer is (1.0)"
)
@click.option("--echo", is_flag=True, help="the line hears itself")
@click.option("--stuffing", metavar="X", help="on or off: byte stuffing (datalink)")
@click.option("--seed", type=Whole(), help="the same faults again")
def simulate(
    devices: tuple[str, ...],
    capture: str | None,
    listen: str | None,
    tap: str | None,
    pace: bool,
    baud: int | None,
    burst: float,
    delay: float,
    faults: tuple[str, ...],
    late: float,
    echo: bool,
    stuffing: str | None,
    seed: int | None,
) -> None:
    """Simulate devices on a line: a plant file's, or those named, with default values.

    flexmax:1+dgfc386 has a card behind it, 53mc5000:3+port is on its configuration port.

    Faults: no-answer late-answer wrong-checksum cut-short noise other-slave wrong-sequence
    gap twice.
    """
    if min(burst, delay, late) < 0:
        raise UsageError("--burst, --delay and --late are times: 0 or more")
    lines = _lines(devices, capture, listen, {} if stuffing is None else {"stuffing": stuffing})
    rates = dict(parse_fault(text) for text in faults)
    served = []
    for where, line in lines:
        settings = line.settings if baud is None else line.settings.with_options(baud=baud)
        character = settings.character if pace else 0.0
        line.simulated.pace = Pace(character, burst / 1000, delay / 1000)
        line.simulated.faults = LineFaults(RandomFaults(rates, seed), late, echo)
        served.append((where, line.simulated))
    if tap is not None and len(served) > 1:
        raise UsageError("--tap is for one line; this plant file has several")
    asyncio.run(_serve(served, tap))


class _Planned(NamedTuple):
    """A line to simulate, and its settings."""

    settings: LineSettings
    simulated: SimulatedLine


def _lines(
    devices: tuple[str, ...], capture: str | None, listen: str | None, own: dict[str, str]
) -> list[tuple[str, _Planned]]:
    """Where each line listens, and what is on it. Raises `UsageError`."""
    if capture is not None:
        if devices or own:
            raise UsageError("--from FILE has its own devices and keys")
        return [(_where(listen), _of_capture(capture))]
    if not devices:
        raise UsageError("which devices? As in flexmax:0 ax-v:2, a plant file, or --from a capture")
    first, *others = devices
    if not first.endswith(".toml"):
        return _named(devices, listen, own)
    if listen or own:
        raise UsageError(
            "a plant file has its own ports and keys: leave --listen and --stuffing away"
        )
    if others:
        raise UsageError(f"{first} has its own devices: leave {' '.join(others)} away")
    return _of_plant(first)


def _plan(devices: list[tuple[Profile, int, str | None]], keys: Mapping[str, str]) -> _Planned:
    """The settings are the first profile's, with the line's own keys."""
    protocols = {profile.protocol for profile, _, _ in devices}
    if len(protocols) > 1:
        raise UsageError(f"one line has one protocol, these have {' and '.join(sorted(protocols))}")
    addresses = [address for _, address, _ in devices]
    for address in addresses:
        if addresses.count(address) > 1:
            raise UsageError(f"address {address} is used twice on one line")
    protocol = PROTOCOLS[protocols.pop()]
    settings = line_settings(protocol, devices[0][0], LineOptions.parse(keys, protocol.options))
    return _line([simulated_device(*device) for device in devices], settings)


def _line(devices: Sequence[SimulatedDevice], settings: LineSettings) -> _Planned:
    simulated = SimulatedLine(devices, settings.decoder, character=settings.character)
    return _Planned(settings, simulated)


def _of_capture(file: str) -> _Planned:
    from multidrop.sim.replay import learn

    learned = learn(file)
    for text in learned.lines():
        click.echo(text, err=True)
    return _line(learned.devices, learned.settings)


def _where(listen: str | None) -> str:
    if listen is None:
        raise UsageError("where? --listen tcp://127.0.0.1:4001 or --listen pty:/tmp/drive")
    return listen


def _named(
    devices: tuple[str, ...], listen: str | None, keys: Mapping[str, str]
) -> list[tuple[str, _Planned]]:
    where = _where(listen)
    named = [parse_simulated(text) for text in devices]
    return [
        (
            where,
            _plan([(load_profile(name), address, behind) for name, address, behind in named], keys),
        )
    ]


def _of_plant(file: str) -> list[tuple[str, _Planned]]:
    plant = load_plant(Path(file), partial(load_profile, config=Path(file)))
    lines = []
    for line, port in plant.lines.items():
        there = [device for device in plant.devices.values() if device.line == line]
        if there:
            devices = [(item.profile, item.device.address or 0, item.behind) for item in there]
            where = port if "://" in port else f"pty:{port}"
            planned = _plan(devices, there[0].device.options)
            lines.append((where.replace("rfc2217://", "tcp://"), planned))
    if not lines:
        raise UsageError(f"{file} has no devices to simulate")
    return lines


async def _serve(lines: list[tuple[str, SimulatedLine]], tap: str | None = None) -> None:
    """Serve until Ctrl-C or SIGTERM; links to pseudo-terminals are removed then."""
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    with contextlib.suppress(NotImplementedError):  # Windows
        loop.add_signal_handler(signal.SIGTERM, ended.set)
    listeners: list[Listener] = []
    try:
        for where, line in lines:
            listeners.append(await serve(line, where, spin=bool(line.pace.character)))
            click.echo(f"listening on {listeners[-1].port}")
            if tap is not None:
                listeners.append(await serve_ears(line, tap))
                click.echo(f"listen to it at {listeners[-1].port}")
        await ended.wait()
    finally:
        for listener in listeners:
            listener.close()
