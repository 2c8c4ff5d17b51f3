"""A line to scan that answers as a test says, in a time of its own."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from multidrop.events import FrameReceived
from multidrop.io.memory import FOREVER, MemoryPort
from multidrop.protocols import PROTOCOLS
from multidrop.tools.scan.sweep import Sweep

Pieces = Sequence[tuple[float, bytes]]
"""What comes, and how many s after the end of the probe it is complete."""


@dataclass(frozen=True)
class Asked:
    """A probe that went out, and when its last byte was on the wire."""

    frame: Any
    end: float


class Wire:
    """Answers frames by `answer`; `unasked` comes by itself, at its time."""

    def __init__(
        self,
        protocol: str,
        answer: Callable[[Any], Pieces] = lambda frame: (),
        *,
        unasked: Pieces = (),
        echo: bool = False,
        character: float = 11 / 9600,
    ) -> None:
        self.protocol = PROTOCOLS[protocol]
        self.asked: list[Asked] = []
        self.sent = b""
        self._decoder = self.protocol.decoder()
        self._answer = answer
        self._echo = echo
        self._character = character
        self._waiting: list[tuple[float, int, bytes]] = []
        for at, data in unasked:
            self._put(at, data)

    def receive(self, data: bytes, now: float) -> None:
        self.sent += data
        end = now + len(data) * self._character
        if self._echo:
            self._put(end, data)
        for event in self._decoder.receive_data(data):
            assert isinstance(event, FrameReceived)
            self.asked.append(Asked(event.frame, end))
            for delay, piece in self._answer(event.frame):
                self._put(end + delay, piece)

    @property
    def deadline(self) -> float:
        return self._waiting[0][0] if self._waiting else FOREVER

    def send(self, now: float) -> bytes:
        if not self._waiting or self._waiting[0][0] > now:
            return b""
        return heapq.heappop(self._waiting)[2]

    def _put(self, at: float, data: bytes) -> None:
        heapq.heappush(self._waiting, (at, len(self._waiting) + len(self.asked) * 100, data))

    def addresses(self) -> list[int]:
        return [item.frame.address for item in self.asked]


def sweep(wire: Wire, addresses: Sequence[int], **options: Any) -> Sweep:
    """A sweep of these addresses at the protocol's usual setting, to its end."""
    made = begun(wire, addresses, **options)
    carry_out(made, MemoryPort(wire))
    return made


def begun(wire: Wire, addresses: Sequence[int], *, wait: float = 0.1, **options: Any) -> Sweep:
    protocol = wire.protocol
    timing = protocol.line.timing(network=False)
    return Sweep(protocol, protocol.decoder(), timing, addresses, wait, **options)


def carry_out(
    machine: Sweep, port: MemoryPort, *, until: float = FOREVER, begin: bool = True
) -> None:
    """Give it bytes and time until it is done, or until a moment; `begin` or go on."""
    to_send = machine.start(port.now()) if begin else b""
    while True:
        if to_send:
            port.write(to_send)
        if machine.done or port.now() >= until:
            break
        data = port.read(machine.deadline - port.now())
        to_send = machine.advance(data, port.now())
