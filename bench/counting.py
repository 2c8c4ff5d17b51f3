"""Simulated devices whose values count: a value says which of a line's answers it came with."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from multidrop.protocols.datalink.reals import encode_real
from multidrop.protocols.slink3 import Format
from multidrop.sim.controller import Controller
from multidrop.sim.datalink import SimulatedInstrument
from multidrop.sim.line import SimulatedDevice
from multidrop.sim.slink3 import Parameter, SimulatedSlave
from multidrop.sim.ultra3000 import SimulatedUltra3000

WRAP = 30_000
"""Counts begin again from 0 here: every protocol has a point that holds them."""


class Count:
    """How many answers there were."""

    def __init__(self) -> None:
        self.number = 0

    def get(self, now: float) -> int:
        return self.number % WRAP


def numbers(text: str) -> list[int]:
    """`0x7E`, `9000-9009`; none of an empty text."""
    first, _, last = text.partition("-")
    return list(range(int(first, 0), int(last or first, 0) + 1)) if text else []


def let_count(
    device: SimulatedDevice, points: Sequence[int], count: Count
) -> Callable[[], None] | None:
    """Let these points of a device show a count: SLINK3 indexes, numbers of C points, parameters.

    Returns what has to be called before each of its answers, None where nothing has to.
    """
    if isinstance(device, SimulatedSlave):
        for index in points:
            device.parameters.known[index, 0] = Parameter(Format.SHORT_INT, get=count.get)
        return None
    if isinstance(device, SimulatedUltra3000):
        for number in points:
            device._measured[number] = count.get
        return None
    assert isinstance(device, SimulatedInstrument)
    controller = device.inside
    assert isinstance(controller, Controller)
    controller.loops = []  # nothing else shall change
    raw = controller.memory.raw
    places = [controller.memory.map.locate("C", number) for number in points]

    def show() -> None:
        value = encode_real(count.get(0.0), 3)
        for place in places:
            raw[place : place + 3] = value

    return show
