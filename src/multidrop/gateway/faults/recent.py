"""What was just heard, kept for the moment in which a device trips: its values, its line's frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from multidrop.device import ProtocolModule
from multidrop.events import FrameReceived
from multidrop.gateway.values import TEXTS, Update
from multidrop.io.cutting import Cut, Cutter
from multidrop.points import Value
from multidrop.timing import LineSettings

PIECES = 16
"""Pieces of bytes that are kept for each frame: adapters deliver answers in several."""


class Past(NamedTuple):
    """What was heard of a point at `monotonic` (s). `value` is the newest good one."""

    monotonic: float
    point: str
    quality: str
    value: Value | None
    unit: str | None
    meaning: str | None


class RecentValues:
    """What was heard of each device in the last `seconds`.

    Tens of thousands may be kept, so they are tuples of plain values: Python's garbage
    collector does not follow these, and its long pauses would hold up the lines.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._kept: dict[str, deque[tuple[Any, ...]]] = {}

    def take(self, update: Update) -> None:
        """A listener of `Values`."""
        device, point, polled, monotonic, _ = update
        kept = self._kept.get(device)
        if kept is None:
            kept = self._kept[device] = deque()
        reading = polled.reading
        quality = TEXTS[polled.quality]
        if reading is None:
            kept.append((monotonic, point, quality, None, polled.point.unit, None))
        else:
            kept.append((monotonic, point, quality, reading.value, reading.unit, reading.meaning))
        oldest = monotonic - self._seconds
        while kept[0][0] < oldest:
            kept.popleft()

    def of(self, device: str) -> list[Past]:
        """Oldest first, the newest included."""
        return [Past(*one) for one in self._kept.get(device, ())]


class Piece(NamedTuple):
    """What a tap is told: bytes, whether this side sent them, when (monotonic, s), and how they came."""

    data: bytes
    sent: bool
    at: float
    damaged: bool


class RecentFrames:
    """A tap that keeps the bytes of the last frames, `frames` at least; they are cut only when asked for."""

    def __init__(self, frames: int) -> None:
        self._frames = frames
        # plain tuples, for the same reason as above
        self._pieces: deque[tuple[bytes, bool, float, bool]] = deque(maxlen=PIECES * frames)
        self._sent = 0

    def __call__(self, data: bytes, sent: bool, at: float, damaged: bool) -> None:
        pieces = self._pieces
        if not self._frames:
            return
        if len(pieces) == pieces.maxlen:
            self._sent -= pieces.popleft()[1]
        pieces.append((data, sent, at, damaged))
        self._sent += sent
        while self._sent > self._frames:
            self._sent -= pieces.popleft()[1]

    def pieces(self) -> list[Piece]:
        """Oldest first, as they are now."""
        return [Piece(*one) for one in self._pieces]


def frames_of(
    pieces: list[Piece],
    protocol: ProtocolModule,
    settings: LineSettings,
    most: int,
    wall: Callable[[float], int],
) -> list[dict[str, Any]]:
    """The last frames in these pieces, at most `most`, as a freeze-frame keeps them."""
    cutter = Cutter(settings)
    cuts: list[Cut] = []
    for piece in pieces:
        if piece.sent:
            cuts += cutter.send(piece.data, piece.at)
        else:
            cuts += cutter.receive(piece.data, piece.at, damaged=piece.damaged)
    cuts += cutter.finish()
    return [_frame(cut, protocol, wall) for cut in cuts[max(0, len(cuts) - most) :]]


def _frame(cut: Cut, protocol: ProtocolModule, wall: Callable[[float], int]) -> dict[str, Any]:
    whole = isinstance(cut.event, FrameReceived)
    return {
        "time": utc(wall(cut.end)),
        "sent": cut.sent,
        "raw": cut.event.raw.hex(),
        "shown": protocol.shown(cut.event.raw),
        "text": protocol.describe(cut.event.frame)
        if isinstance(cut.event, FrameReceived)
        else f"damaged: {cut.event.reason}",
        "damaged": not whole,
    }


def utc(nanoseconds: int) -> str:
    """ns since 1970 as freeze-frames have it."""
    time = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=nanoseconds // 1000)
    return shown_time(time)


def shown_time(time: datetime) -> str:
    """As JSON has it: UTC, microseconds, Z."""
    return time.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")
