"""A capture of everything that may pass on the lines of all three protocols, made from simulated ones."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from multidrop.catalog import load_profile
from multidrop.conversation import Conversation, Wait
from multidrop.device import ProtocolModule
from multidrop.errors import Error
from multidrop.events import Damaged
from multidrop.io.capture import CaptureTap, CaptureWriter
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.naming import LineOptions
from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000
from multidrop.protocols.slink3 import FLEXMAX
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault, RandomFaults
from multidrop.sim.line import LineFaults, SimulatedLine
from multidrop.timing import LineSettings

START_NS = 1_800_000_000 * 10**9
FAULTS = dict.fromkeys(Fault, 0.03)

Talk = Callable[[random.Random], Any]  # gives a conversation


@dataclass(frozen=True)
class Plant:
    """A line, what stands on it, and what a master may say there."""

    protocol: str
    devices: tuple[tuple[str, int, str | None], ...]
    options: dict[str, str]
    talks: tuple[Talk, ...]

    @property
    def settings(self) -> LineSettings:
        return PROTOCOLS[self.protocol].line_for(self.options)


def _device(profile: str, address: int, **options: str) -> Any:
    loaded = load_profile(profile)
    return PROTOCOLS[loaded.protocol].device(address, loaded, options)


def _reads(profile: str, address: int, **options: str) -> Talk:
    """Reads of the profile's points, as many at once as one message takes."""
    device = _device(profile, address, **options)
    described = load_profile(profile).points.values()
    points = [device.point(item.at + (".0" if item.elements else "")) for item in described]

    def talk(dice: random.Random) -> Any:
        first = dice.randrange(len(points))
        return device.read_group(dice.choice(device.plan(points[first : first + 20])))

    return talk


def _texts(profile: str, address: int, *texts: str) -> Talk:
    device = _device(profile, address)
    return lambda dice: device.read(device.point(dice.choice(texts)))


def _writes(profile: str, address: int, *writes: str, **options: str) -> Talk:
    device = _device(profile, address, **options)

    def talk(dice: random.Random) -> Any:
        point, _, value = dice.choice(writes).partition("=")
        return device.write(device.prepare_write(point, value, force=True))

    return talk


def _raw(profile: str, address: int, *bodies: str) -> Talk:
    device = _device(profile, address)
    return lambda dice: device.prepare_raw(dice.choice(bodies))()


def _services(profile: str, address: int) -> Talk:
    device = _device(profile, address)
    return lambda dice: dice.choice([device.status, device.clear_faults])()


def _broadcast(dice: random.Random) -> Conversation[Any, Any]:
    points = [("8236:int16", str(dice.randrange(100)))]
    return PROTOCOLS["slink3"].prepare_broadcast(load_profile("flexmax"), points, [0, 1], {})()


PLANTS = (
    Plant(
        "slink3",
        (("flexmax", 0, "dgfc386"), ("flexmax", 1, None), ("ax-v", 2, None)),
        {},
        (
            _texts(
                "flexmax", 0, "8236:int16", "8236", "dgfc/511", "std/0x6041.0:uint16", "7:int16"
            ),
            _texts("flexmax", 1, "actual_speed", "8236.1:string", "8511:uint16", "9999:float32"),
            _texts("ax-v", 2, "1009", "1111:int16", "1009:float32", "5:bool"),
            _texts("flexmax", 9, "8236:int16"),
            _writes("flexmax", 1, "8236:int16=1234", "8236:int16=-1", "speed_setpoint=4000"),
            _writes("ax-v", 2, "1111=3", "1009=-7"),
            _services("flexmax", 0),
            _broadcast,
            _raw("flexmax", 0, *(f"{command.value & 0xFF:02X} 00" for command in FLEXMAX.commands)),
            _raw("flexmax", 0, "dgfc/CD AB 11 22", "2A 00 01", "50 00", "01 02 03"),
        ),
    ),
    Plant(
        "datalink",
        (("53mc5000", 3, None), ("53sl6000", 4, None), ("datalink", 30, None)),
        {},
        (
            _reads("53mc5000", 3),
            _writes("53mc5000", 3, "C101=50", "C101=-0.4921875", "L106=1", "B338=126", "A8=~~~"),
            _texts("53mc5000", 30, "C100", "H0", "mem/0x7E7E/3"),
            _texts("53sl6000", 4, "H0", "A0", "mem/0x1000/9"),
            _texts("53mc5000", 7, "C100"),
            _services("53mc5000", 3),
        ),
    ),
    Plant(
        "datalink",
        (("53mc5000", 3, None),),
        {"stuffing": "off"},
        (
            _reads("53mc5000", 3, stuffing="off"),
            _writes("53mc5000", 3, "A8=~~~", "B338=126", "L106=0", stuffing="off"),
        ),
    ),
    Plant(
        "ultra3000",
        (("ultra3000", 0, None), ("ultra3000", 5, None)),
        {},
        (
            _reads("ultra3000", 0),
            _reads("ultra3000", 5),
            _texts("ultra3000", 0, "kp@default", "kp@max", "0x05B.7", "0x7EE", "0x05B.99@nv"),
            _writes("ultra3000", 5, "kp=5", "preset_velocity.3=2500", "kp@nv=6"),
            _raw("ultra3000", 0, "0114", "0115", "0711", "05BA", "05BB", "06D112345678"),
            _services("ultra3000", 0),
        ),
    ),
)


def talk_on(writer: CaptureWriter, plant: Plant, frames: int, *, echo: bool, seed: int) -> None:
    """Let a master say this and that, on a faulty line, until so many packets were written."""
    protocol, settings = PROTOCOLS[plant.protocol], plant.settings
    dice = random.Random(seed)
    devices = [simulated_device(*where) for where in plant.devices]
    wire = SimulatedLine(
        devices,
        settings.decoder,
        character=settings.character,
        faults=LineFaults(RandomFaults(FAULTS, seed), echo=echo),
    )
    line = Line(MemoryPort(wire.attach()), settings, LineOptions(echo="on" if echo else "off"))
    tap = CaptureTap(
        writer,
        protocol,
        settings,
        "/dev/sim",
        own=plant.options,
        wall=lambda now: START_NS + int(now * 1e9),
    )
    line.taps.append(tap)
    until = writer.packets + frames
    while writer.packets < until:
        with contextlib.suppress(Error):
            line.run(dice.choice(plant.talks)(dice))
        line.run(_rest(dice.choice((0.0, 0.01, 0.5))))
    tap.finish()


def _rest(seconds: float) -> Conversation[Any, None]:
    yield Wait(seconds)


# -- what no device says ------------------------------------------------------------------------


def any_slink3(dice: random.Random) -> bytes:
    codes = [*slink3.Command, *slink3.Response, dice.randrange(0x10000)]
    types = [*slink3.Format, dice.randrange(256)]
    data = bytes((dice.choice(types) | dice.choice((0, 0x80)),)) + dice.randbytes(
        dice.randrange(12)
    )
    return slink3.Frame(
        dice.choice((0, 1, 127, 255, dice.randrange(256))),
        dice.choice((dice.randrange(16) << 2, dice.randrange(256))),
        dice.choice((0, 1, 4, 5, 0x11, dice.randrange(256))),
        dice.choice(codes),
        dice.choice((b"", data, dice.randbytes(dice.randrange(248)))),
    ).encode()


def any_datalink(dice: random.Random) -> bytes:
    command = dice.choice(list(datalink.Command))
    if command is datalink.Command.ACKNOWLEDGE:
        return datalink.Frame(command, dice.randrange(32)).encode()
    count = dice.randrange(33)
    data = bytes(dice.choice((0x7E, 0, dice.randrange(256))) for _ in range(count))
    body = b"" if command is datalink.Command.INTERROGATE else data
    where = dice.choice((0x7E7E, dice.randrange(0x10000)))
    return datalink.Frame(command, dice.randrange(32), where, count, body).encode()


def any_ultra3000(dice: random.Random) -> bytes:
    parameter = dice.randrange(0x1000)
    digits = "".join(dice.choices("0123456789ABCDEF", k=dice.choice((0, 2, 4, 8, 245))))
    if parameter >= 0x800:
        digits = dice.choice((digits, f"{dice.randrange(12):02X}"))
    return ultra3000.Frame(dice.randrange(256), parameter, dice.randrange(16), digits).encode()


ANY = {"slink3": any_slink3, "datalink": any_datalink, "ultra3000": any_ultra3000}


def broken(raw: bytes, dice: random.Random) -> bytes:
    """The same bytes, or as a bad line delivers them."""
    at = dice.randrange(len(raw))
    flipped = raw[:at] + bytes((raw[at] ^ 1 << dice.randrange(8),)) + raw[at + 1 :]
    return dice.choice((raw, raw, raw, raw, flipped, raw[:at], raw[at:], dice.randbytes(3) + raw))


def babble_on(writer: CaptureWriter, protocol: ProtocolModule, frames: int, *, seed: int) -> None:
    """Frames that nobody asked for, of every kind, and what a bad line makes of them."""
    dice = random.Random(seed)
    line = writer.add_line(protocol, protocol.line, "/dev/babble")
    until = writer.packets + frames
    now = START_NS
    while writer.packets < until:
        decoder = protocol.decoder()
        stream = broken(ANY[protocol.name](dice), dice)
        for event in [*decoder.receive_data(stream), *decoder.silence()]:
            now += dice.randrange(10**7, 10**9)
            damage = event.reason if isinstance(event, Damaged) else ""
            sent = dice.choice((None, None, False))
            writer.add(line, event.raw, now, sent=sent, damage=damage)


def write_traffic(path: Path, frames: int) -> None:
    """A capture of at least so many packets: half of it dialogues, half of it babble."""
    with contextlib.closing(CaptureWriter.create(path)) as writer:
        for index, plant in enumerate(PLANTS):
            for echo in (False, True):
                talk_on(writer, plant, frames // 16, echo=echo, seed=2 * index + echo)
        for seed, protocol in enumerate(_protocols()):
            babble_on(writer, protocol, frames // 6 + 1, seed=seed)
        assert writer.failed is None


def _protocols() -> Iterator[ProtocolModule]:
    return (PROTOCOLS[name] for name in PROTOCOLS)
