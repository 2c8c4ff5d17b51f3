"""What a doctor has heard of a line, byte by byte with its time, and what a decoder makes of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

from multidrop.device import ProtocolModule
from multidrop.events import Damaged, FrameReceived
from multidrop.timing import LineSettings
from multidrop.tools.ears import GLITCH, Ear, Piece

ENOUGH = 2
"""Whole frames by which traffic is understood."""


@dataclass(frozen=True, slots=True)
class Asked:
    """One read, and everything that was heard from its first byte until the next one.

    `end` is when its last byte has left, as reckoned.
    """

    frame: Any
    raw: bytes
    start: float
    end: float
    pieces: tuple[Piece, ...]
    alone: bool  # nobody else was asked within the longest time of an answer before it


@dataclass(frozen=True, slots=True)
class Evidence:
    """One visit to a line at one setting. `latency_ms` is the timer of a USB adapter, where it has one."""

    port: str
    protocol: ProtocolModule
    settings: LineSettings
    network: bool
    seconds: float  # for which it was listened to before anything was asked
    heard: tuple[Piece, ...] = ()
    asked: tuple[Asked, ...] = ()
    latency_ms: int | None = None

    @property
    def understood(self) -> bool:
        """Whether what was heard are mostly frames of this protocol. Marks and rests cut nothing."""
        ear = Ear(self.protocol, self.settings.decoder())
        for piece in self.heard:
            ear.receive(piece.data)
        ear.silence()
        return ear.understands(ENOUGH)

    @property
    def setting(self) -> str:
        return f"{self.protocol.name} {self.settings.baud} {self.settings.format}"


class Arrived(NamedTuple):
    """A whole frame and when it came: the start of its first byte, the end of its last.

    `gap` is the longest rest between two of its bytes, beyond what those take that came
    together; `pieces` are the sizes in which it was delivered; `marked` is how many of its bytes
    the port marked as wrong.
    """

    frame: Any
    raw: bytes
    start: float
    end: float
    gap: float
    pieces: tuple[int, ...]
    marked: int


class Broken(NamedTuple):
    """Bytes that belong to no frame."""

    raw: bytes
    reason: str
    start: float
    marked: int


@dataclass(slots=True)
class Examined:
    """What was heard in one stretch of time. Marks and rests are noted and cut nothing."""

    frames: list[Arrived] = field(default_factory=list)
    broken: list[Broken] = field(default_factory=list)
    size: int = 0
    marked: int = 0


def examine(
    pieces: tuple[Piece, ...], protocol: ProtocolModule, settings: LineSettings
) -> Examined:
    """Put the pieces together again. Every byte comes out once."""
    stretch = _Stretch(pieces, settings.character)
    found = Examined(size=len(stretch.data), marked=sum(stretch.marks))
    decoder = settings.decoder()
    at = 0
    for event in (*decoder.receive_data(stretch.data), *decoder.silence()):
        at = max(at, stretch.data.find(event.raw, at))  # a decoder may skip a byte without a word
        until = at + len(event.raw)
        if isinstance(event, Damaged):
            found.broken.append(stretch.broken(event, at, until))
        else:
            found.frames.append(stretch.arrived(event, at, until))
        at = until
    return found


class _Stretch:
    """Bytes with the time at which each began and ended, reckoned back from the end of its piece."""

    def __init__(self, pieces: tuple[Piece, ...], character: float) -> None:
        self.data = b"".join(piece.data for piece in pieces)
        self.marks = [piece.damaged for piece in pieces for _ in piece.data]
        self._ends: list[float] = []
        self._piece_of: list[int] = []
        self._character = character
        for number, piece in enumerate(pieces):
            for left in range(len(piece.data) - 1, -1, -1):
                self._ends.append(piece.now - left * character)
                self._piece_of.append(number)

    def arrived(self, event: FrameReceived[Any], at: int, until: int) -> Arrived:
        ends = self._ends[at:until]
        rests = [later - sooner - self._character for sooner, later in pairwise(ends)]
        pieces = self._piece_of[at:until]
        sizes = tuple(pieces.count(number) for number in dict.fromkeys(pieces))
        return Arrived(
            event.frame,
            event.raw,
            ends[0] - self._character,
            ends[-1],
            max(rests, default=0.0),
            sizes,
            sum(self.marks[at:until]),
        )

    def broken(self, event: Damaged, at: int, until: int) -> Broken:
        start = self._ends[at] - self._character
        return Broken(event.raw, event.reason, start, sum(self.marks[at:until]))


__all__ = ["GLITCH", "Arrived", "Asked", "Broken", "Evidence", "Examined", "Piece", "examine"]
