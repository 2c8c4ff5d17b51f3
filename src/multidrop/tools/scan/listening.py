"""Listening before speaking: is there a master on this line already? No clock in here either."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from multidrop.decoder import Decoder
from multidrop.device import ProtocolModule
from multidrop.events import Damaged, FrameReceived

MOST_SHOWN = 12  # frames
GLITCH = 3
"""So few damaged bytes are what a transmitter makes that is switched on, and nobody's traffic."""


@dataclass(slots=True)
class Heard:
    """What a protocol's decoder made of it."""

    frames: int = 0
    damaged: int = 0  # bytes
    lines: list[str] = field(default_factory=list)  # of the first frames: bytes and meaning
    addresses: set[int] = field(default_factory=set)  # of those that answered


class Listening:
    """Listens for `seconds` with the decoders of several protocols at once."""

    def __init__(
        self, decoders: Mapping[str, tuple[ProtocolModule, Decoder[Any]]], seconds: float
    ) -> None:
        self._decoders = decoders
        self._seconds = seconds
        self.heard = {name: Heard() for name in decoders}
        self.size = 0  # bytes
        self.deadline = 0.0
        self.done = False

    def start(self, now: float) -> bytes:
        """Begin; there is never anything to send."""
        self.deadline = now + self._seconds
        return b""

    def advance(self, data: bytes, now: float, *, damaged: bool = False) -> bytes:
        """Take bytes that arrived, or none at the deadline."""
        self.size += len(data)
        for name, (protocol, decoder) in self._decoders.items():
            events = decoder.line_error(data) if damaged else decoder.receive_data(data)
            self._take(protocol, self.heard[name], events)
        if now >= self.deadline:
            for name, (protocol, decoder) in self._decoders.items():
                self._take(protocol, self.heard[name], decoder.silence())
            self.done = True
        return b""

    @property
    def speaking(self) -> bool:
        """Whether somebody is there: a frame that was understood, or more than a glitch."""
        return self.size > GLITCH or self.understood is not None

    @property
    def understood(self) -> str | None:
        """The protocol whose frames they are: the one that made most of them."""
        name = max(self.heard, key=lambda name: self._sense(self.heard[name]), default=None)
        return name if name is not None and self.heard[name].frames else None

    @staticmethod
    def _sense(heard: Heard) -> tuple[bool, int, int]:
        return bool(heard.frames), -heard.damaged, heard.frames

    @staticmethod
    def _take(
        protocol: ProtocolModule, heard: Heard, events: Iterable[FrameReceived[Any] | Damaged]
    ) -> None:
        for event in events:
            if isinstance(event, Damaged):
                heard.damaged += len(event.raw)
                continue
            heard.frames += 1
            if not protocol.from_master(event.frame):
                heard.addresses.add(event.frame.address)
            if len(heard.lines) < MOST_SHOWN:
                raw = event.raw.hex(" ").upper()
                heard.lines.append(f"{raw}  | {protocol.describe(event.frame)}")
