"""Simulated lines to talk to without waiting: the time is an argument."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

from multidrop.conversation import Conversation
from multidrop.io.line import Line
from multidrop.io.memory import FOREVER, MemoryPort
from multidrop.naming import LineOptions
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Frame
from multidrop.sim.faults import ScriptedFaults
from multidrop.sim.line import Connection, LineFaults, Pace, SimulatedDevice, SimulatedLine
from multidrop.sim.slink3 import FlexMax, SimulatedSlave, ax_v, dgfc386

ResultT = TypeVar("ResultT")


def plant() -> list[SimulatedSlave]:
    """The devices of the documents' examples: two drives, one with a card behind it, and an AX-V."""
    return [FlexMax(0, dgfc386(0)), FlexMax(1), ax_v(2)]


def simulated(
    devices: Iterable[SimulatedDevice] | None = None,
    *,
    pace: Pace | None = None,
    faults: LineFaults | None = None,
) -> SimulatedLine:
    found = plant() if devices is None else devices
    return SimulatedLine(found, slink3.decoder, pace=pace, faults=faults)


def scripted(*faults: Any, late: float = 1.0, echo: bool = False) -> LineFaults:
    """These faults, one an answer, then none."""
    return LineFaults(ScriptedFaults(faults), late, echo)


class Wire:
    """A master's line to simulated devices, and its clock."""

    def __init__(self, line: SimulatedLine, **options: str) -> None:
        chosen = LineOptions.parse(options, {})
        self.port = MemoryPort(line.attach())
        settings = slink3.LINE.with_options(**chosen.line_settings())
        self.line = Line(self.port, settings, chosen)

    def run(self, conversation: Conversation[Any, ResultT]) -> ResultT:
        return self.line.run(conversation)

    def wait(self, seconds: float) -> None:
        assert self.port.read(seconds) == b""

    @property
    def now(self) -> float:
        return self.port.now()


def heard(end: Connection, until: float = FOREVER) -> list[tuple[float, bytes]]:
    """All that a line sends from now on, each piece with its time."""
    pieces = []
    while end.deadline <= until and end.deadline < FOREVER:
        at = end.deadline
        data = end.send(at)
        if data:
            pieces.append((at, data))
    return pieces


def exchanged(line: SimulatedLine, *requests: Frame, now: float = 0.0) -> list[Frame]:
    """The answers to requests that are sent one after the other."""
    end = line.attach()
    answers = []
    for request in requests:
        end.receive(request.encode(), now)
        answers += [Frame.decode(data) for _, data in heard(end)]
    return answers
