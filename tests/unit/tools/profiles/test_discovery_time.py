"""The time that a discovery foretells, on lines that keep their own time: to the byte, and without waiting."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.events import Damaged, FrameReceived
from multidrop.io.connection import Connection, Target
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.naming import parse_device
from multidrop.profile import PointDescription, Profile
from multidrop.protocols.datalink import Frame
from multidrop.sim.controller import Controller
from multidrop.sim.datalink import SimulatedInstrument
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Pace, SimulatedDevice, SimulatedLine
from multidrop.tools.profiles.discover import Discovery

TYPES = ("int16", "uint16", "int32", "uint32", "float32")
CLUSTERS = [*range(8000, 8040), *range(8236, 8260, 3), *range(8700, 8720), *range(9100, 9160, 2)]
PRESS = Profile(
    "press",
    "slink3",
    dialect="flexmax",
    points={
        f"p{at}": PointDescription(f"p{at}", f"{at}:{TYPES[number % len(TYPES)]}")
        for number, at in enumerate(CLUSTERS)
    },
)


def on_a_paced_line(name: str, device: SimulatedDevice) -> Connection:
    """9600 baud; every byte takes its time on the wire, and an answer comes after 5 ms."""
    target = Target(parse_device(f"{name}@memory,baud=9600"))
    settings = target.settings
    pace = Pace(settings.character, answer_delay=0.005)
    wire = SimulatedLine([device], settings.decoder, pace=pace)
    line = Line(MemoryPort(wire.attach()), settings, target.options)
    return Connection(target, target.device(), line)


def wrong(connection: Connection, where: str) -> float:
    """By how much of the time that it took the time was foretold wrongly."""
    run = Discovery(connection, where)
    said = run.estimate()
    started = connection.line.port.now()
    for _ in run.run():
        pass
    return said / (connection.line.port.now() - started) - 1


@pytest.mark.parametrize(
    ("there", "asked", "where"),
    [
        (load_profile("flexmax"), "flexmax:1", "8000..9999"),
        (PRESS, "flexmax:1", "8000..9999"),
        (load_profile("ax-v"), "ax-v:1", "0..1999"),
        (load_profile("flexmax"), "flexmax:1", "std/0x6000..0x67CF"),
        (PRESS, "flexmax:1", "8000..8499.0..3"),
        (load_profile("ultra3000"), "ultra3000:1", "0x000..0x7CF"),
        (load_profile("53mc5000"), "53mc5000:1", "0x0000..0xF9FF"),
    ],
)
def test_within_five_hundredths_for_2000_places(there: Profile, asked: str, where: str) -> None:
    connection = on_a_paced_line(asked, simulated_device(there, 1))
    assert abs(wrong(connection, where)) < 0.05


class Silent(SimulatedInstrument):
    """An instrument that says nothing of some of its memory."""

    def receive(self, events: list[FrameReceived[Frame] | Damaged], now: float) -> list[bytes]:
        return super().receive([event for event in events if not self._of_it(event)], now)

    def _of_it(self, event: FrameReceived[Frame] | Damaged) -> bool:
        return isinstance(event, FrameReceived) and 0x3000 <= event.frame.memory_address < 0x4000


def test_what_stays_silent_takes_its_time_twice() -> None:
    connection = on_a_paced_line("53mc5000:1", Silent(1, Controller(1)))
    assert abs(wrong(connection, "0x0000..0xF9FF")) < 0.05
