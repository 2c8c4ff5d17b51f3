"""Simulated Datalink instruments: a 53MC5000 with loops, a 53SL6000 as memory."""

from __future__ import annotations

from typing import Protocol

from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.profile import Profile
from multidrop.protocols.datalink import Frame, Slave
from multidrop.protocols.datalink.memory import MAP_B
from multidrop.protocols.datalink.slave import Reply, Request
from multidrop.sim.controller import SCAN, Controller, Memory
from multidrop.sim.faults import Fault

ACKNOWLEDGE_WITHIN = 0.1
"""s after its echo, in which an instrument takes the Acknowledge (53IT5100A)."""

ENTRY = bytes.fromhex("03 1B 0E 15")
ENTERED = bytes.fromhex("1B 20 0E 20 15")
LEAVES_AFTER = 30.0
"""s without a byte, after which a configuration port leaves Datalink."""


class Inside(Protocol):
    """What an instrument is made of, as far as a host can see."""

    memory: Memory

    def advance(self, now: float) -> None: ...
    def end_of_scan(self, now: float) -> float: ...


class Still:
    """Memory and nothing that changes it: a 53SL6000, of which little is known."""

    def __init__(self, address: int) -> None:
        self.memory = Memory(MAP_B)
        self.memory.set_text("A", 0, "SIMULATED")

    def advance(self, now: float) -> None:
        pass

    def end_of_scan(self, now: float) -> float:
        return (int(now / SCAN) + 1) * SCAN


class SimulatedInstrument:
    """An instrument on a line, or alone on its configuration port."""

    def __init__(self, address: int, inside: Inside, *, configuration_port: bool = False) -> None:
        self.slave = Slave(address)
        self.inside = inside
        self._port = configuration_port
        self._open_until = 0.0
        self._echoed_at = 0.0
        self._frame: type[Frame] = Frame  # as it was asked: stuffed or not
        self._applies: list[tuple[float, Request]] = []  # (end of the scan, acknowledged change)

    @property
    def address(self) -> int:
        return self.slave.address

    def receive(self, events: list[FrameReceived[Frame] | Damaged], now: float) -> list[bytes]:
        self.advance(now)
        if self._port:
            opened = self._enter(events, now)
            if opened or now > self._open_until:
                return opened
            self._open_until = now + LEAVES_AFTER
            self._answer_to_all(events)
        if now > self._echoed_at + ACKNOWLEDGE_WITHIN:
            self.slave.acknowledge_overdue()
        answers = []
        for request in self.slave.receive_events(events):
            self._frame = type(request.frame)
            if request.acknowledged:
                self._applies.append((self.inside.end_of_scan(now), request))
                continue
            if request.settled is not None:
                self._echoed_at = now
            answers.append(self.slave.answer(request, request.settled or self._read(request)))
        return answers

    def advance(self, now: float) -> None:
        """Apply the changes whose scan is over, and let the loops run."""
        for due, request in [item for item in self._applies if item[0] <= now]:
            self.inside.advance(due)
            at, memory = request.memory_address, self.inside.memory.raw
            memory[at : at + request.count] = request.changed(
                bytes(memory[at : at + request.count])
            )
            self._applies.remove((due, request))
        self.inside.advance(now)

    def disguise(self, answer: bytes, fault: Fault) -> bytes:
        """The answer of the instrument next door; there are no sequence numbers to be wrong."""
        frame = self._frame.decode(answer)
        return frame._replace(address=(frame.address + 1) % 32).encode()

    def _read(self, request: Request) -> Reply:
        at = request.memory_address
        return Reply(bytes(self.inside.memory.raw[at : at + request.count]))

    def _enter(self, events: list[FrameReceived[Frame] | Damaged], now: float) -> list[bytes]:
        """The entry sequence of a configuration port, which opens it for 30 s from the last byte on."""
        if any(isinstance(event, Damaged) and ENTRY in event.raw for event in events):
            self._open_until = now + LEAVES_AFTER
            return [ENTERED]
        return []

    def _answer_to_all(self, events: list[FrameReceived[Frame] | Damaged]) -> None:
        """A configuration port answers any address, as if it were its own."""
        for event in events:
            if isinstance(event, FrameReceived):
                self.slave.address = event.frame.address


def simulated(profile: Profile, address: int, behind: str | None) -> SimulatedInstrument:
    """The instrument of a profile's memory map. Raises `UsageError`."""
    if behind not in (None, "port"):
        raise UsageError(
            f"{profile.name} has no {behind} behind it; +port is its configuration port"
        )
    inside: Inside = Still(address) if profile.dialect == "map-b" else Controller(address)
    return SimulatedInstrument(address, inside, configuration_port=behind == "port")


def unknown(question: Frame) -> bytes | None:
    """An instrument never refuses: what it does not like, it does not answer."""
    return None
