"""Devices that answer as others did: learned from a capture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.io.captured import CaptureReader, Interface
from multidrop.observer import Found, Observer
from multidrop.sim.devices import unknown_answer
from multidrop.sim.faults import Fault
from multidrop.sim.line import Later
from multidrop.timing import LineSettings
from multidrop.transaction import Transaction

MOST_ANSWERS = 1000
"""To one question; after so many they begin again."""
MOST_QUESTIONS = 100_000
"""Of all devices; a master that writes another value each time asks another question each time."""


@dataclass(slots=True)
class Answers:
    """What was answered to one question, in turn: frame and s after the question, or None."""

    given: list[tuple[Any, float] | None] = field(default_factory=list)
    _next: int = 0

    def add(self, answer: tuple[Any, float] | None) -> None:
        if len(self.given) < MOST_ANSWERS:
            self.given.append(answer)

    def take(self) -> tuple[Any, float] | None:
        found = self.given[self._next]
        self._next = (self._next + 1) % len(self.given)
        return found


class ReplayedDevice:
    """One device. A question is the same whatever its sequence number."""

    def __init__(
        self, address: int, protocol: ProtocolModule, unknown: Callable[[Any], bytes | None]
    ) -> None:
        self._address = address
        self._protocol = protocol
        self._unknown = unknown
        self.answers: dict[Any, Answers] = {}

    @property
    def address(self) -> int:
        return self._address

    @property
    def times(self) -> list[float]:
        """s from a question to its answer, of each answer that there was."""
        known = (given for answers in self.answers.values() for given in answers.given)
        return [given[1] for given in known if given is not None]

    def learn(self, question: Any, answer: tuple[Any, float] | None) -> None:
        self.answers.setdefault(question.numbered(0), Answers()).add(answer)

    def receive(
        self, events: list[FrameReceived[Any] | Damaged], now: float
    ) -> list[bytes | Later]:
        found = []
        for event in events:
            if isinstance(event, FrameReceived) and event.frame.address == self._address:
                answer = self._answer(event.frame)
                if answer is not None:
                    found.append(answer)
        return found

    def _answer(self, question: Any) -> bytes | Later | None:
        known = self.answers.get(question.numbered(0))
        if known is None:
            return self._unknown(question) if self._protocol.continues((), question) else None
        given = known.take()
        if given is None:
            return None
        answer, after = given
        return Later(answer.numbered(_number(question)).encode(), after)

    def disguise(self, answer: bytes, fault: Fault) -> bytes:
        """The answer of the device next door, or one with another sequence number."""
        (event,) = self._protocol.decoder().receive_data(answer)
        frame = event.frame  # type: ignore[union-attr]  # whole, since we made it
        if fault is Fault.OTHER_SLAVE:
            disguised: bytes = frame._replace(address=(frame.address + 1) % 32).encode()
        else:
            disguised = frame.numbered(_number(frame) + 7).encode()
        return disguised


def _number(frame: Any) -> int:
    """Its sequence number; 0 where its protocol has none."""
    return next((n for n in range(frame.NUMBERS) if frame.numbered(n) == frame), 0)


@dataclass(frozen=True, slots=True)
class Learned:
    """What a capture has taught."""

    interface: Interface
    settings: LineSettings
    devices: list[ReplayedDevice]

    def lines(self) -> Iterator[str]:
        """For a person."""
        yield f"learned from {self.interface.description or 'a line'} {self.interface.name}".rstrip()
        for device in self.devices:
            known = self.interface.devices.get(device.address)
            name = f" ({known.name or known.profile})" if known is not None else ""
            silent = sum(
                given is None for answers in device.answers.values() for given in answers.given
            )
            text = (
                f"  address {device.address}{name}: {len(device.answers):,} questions, "
                f"{len(device.times):,} answers after {median(device.times) * 1000:.1f} ms (median)"
            )
            yield text + (f", {silent:,} times no answer" if silent else "")


def learn(path: str | Path) -> Learned:
    """Learn the devices of a capture. Raises `UsageError` where there is none in it."""
    reader = CaptureReader(path)
    pupil: _Pupil | None = None
    for packet in reader.packets():
        interface = reader.interfaces[packet.interface]
        if pupil is None:
            pupil = _Pupil(str(path), interface, packet.time_ns)
        elif interface != pupil.interface:
            raise UsageError(
                f"{path} holds the traffic of several lines, {pupil.interface.name} and "
                f"{interface.name}: one can be simulated"
            )
        if not packet.damaged:
            pupil.hear(packet.data, packet.time_ns, packet.sent)
    if pupil is None or not pupil.devices:
        raise UsageError(f"{path} holds no question that was answered")
    devices = [pupil.devices[address] for address in sorted(pupil.devices)]
    return Learned(pupil.interface, pupil.settings, devices)


class _Pupil:
    """Learns from one line."""

    def __init__(self, path: str, interface: Interface, base_ns: int) -> None:
        if interface.protocol is None:
            raise UsageError(f"{path} holds bytes of no known protocol: who asks what is not known")
        self.interface = interface
        self.protocol: ProtocolModule = interface.protocol
        self.settings = interface.settings(self.protocol)
        self.devices: dict[int, ReplayedDevice] = {}
        self._unknown = unknown_answer(self.protocol.name)
        self._observer = Observer(self.protocol, self.settings, {})
        self._decoder = self.settings.decoder()
        self._base_ns = base_ns
        self._silent: dict[int, list[Any]] = {}  # of devices that have not answered yet
        self._questions = 0

    def hear(self, raw: bytes, time_ns: int, sent: bool | None) -> None:
        now = (time_ns - self._base_ns) / 1e9
        for event in (*self._decoder.receive_data(raw), *self._decoder.silence()):
            self._learn(self._observer.frame(event, now, sent))

    def _learn(self, found: list[Found]) -> None:
        for item in found:
            if isinstance(item, Transaction):
                self._transaction(item)

    def _transaction(self, found: Transaction) -> None:
        """The first frame is a question, the second its answer; what follows wants none."""
        question, *others = [heard.frame for heard in found.frames]
        device = self.devices.get(found.address)
        answered = bool(others) and found.answer_ms is not None
        if device is None and answered:
            device = self.devices[found.address] = ReplayedDevice(
                found.address, self.protocol, self._unknown
            )
            for asked in self._silent.pop(found.address, []):
                device.learn(asked, None)
        if device is None:
            asked_before = self._silent.setdefault(found.address, [])
            if len(asked_before) < MOST_ANSWERS:
                asked_before.append(question)
            return
        if self._questions >= MOST_QUESTIONS and question.numbered(0) not in device.answers:
            return
        before = len(device.answers)
        if found.answer_ms is not None:
            device.learn(question, (others[0], found.answer_ms / 1000))
            for other in others[1:]:
                device.learn(other, None)
        else:
            device.learn(question, None)
        self._questions += len(device.answers) - before
