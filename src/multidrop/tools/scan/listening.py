"""Listening before speaking: is there a master on this line already? No clock in here either."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from multidrop.events import Damaged, FrameReceived
from multidrop.tools.ears import GLITCH, Ear, told

MOST_SHOWN = 12  # frames
ENOUGH = 1
"""Whole frames by which a protocol is told: who is about to speak cannot be too careful."""


@dataclass(slots=True)
class Heard:
    """What a person is shown of what a protocol's decoder made of it."""

    lines: list[str] = field(default_factory=list)  # of the first frames: bytes and meaning
    addresses: set[int] = field(default_factory=set)  # of those that answered


class Listening:
    """Listens for `seconds` with the decoders of several protocols at once."""

    def __init__(self, ears: Mapping[str, Ear], seconds: float) -> None:
        self._ears = ears
        self._seconds = seconds
        self.heard = {name: Heard() for name in ears}
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
        for name, ear in self._ears.items():
            self._show(name, ear.receive(data, damaged=damaged))
        if now >= self.deadline:
            for name, ear in self._ears.items():
                self._show(name, ear.silence())
            self.done = True
        return b""

    @property
    def speaking(self) -> bool:
        """Whether somebody is there: a frame, however short, or more bytes than a glitch has."""
        return self.size > GLITCH or any(heard.lines for heard in self.heard.values())

    @property
    def understood(self) -> str | None:
        """The protocol whose frames they are."""
        ear = told(self._ears.values(), ENOUGH)
        return ear.protocol.name if ear is not None else None

    def _show(self, name: str, events: Iterable[FrameReceived[Any] | Damaged]) -> None:
        heard, protocol = self.heard[name], self._ears[name].protocol
        for event in events:
            if isinstance(event, Damaged):
                continue
            if not protocol.from_master(event.frame):
                heard.addresses.add(event.frame.address)
            if len(heard.lines) < MOST_SHOWN:
                raw = event.raw.hex(" ").upper()
                heard.lines.append(f"{raw}  | {protocol.describe(event.frame)}")
