"""Which protocol a line speaks: all of them listen, until one has understood enough."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from multidrop.decoder import Decoder
from multidrop.device import ProtocolModule
from multidrop.events import Damaged, FrameReceived

ENOUGH = 3
"""Whole frames by which a protocol is told."""
LEAST_FRAME = 6
"""Bytes: a shorter frame has no checksum, and proves nothing."""
SHARE = 0.5
"""Of the bytes since its first frame that have to be in frames: chance makes one now and then."""
MOST_KEPT = 16384
"""Bytes that are kept for the winner; older ones are given up as they are."""


class Piece(NamedTuple):
    """Bytes as they came."""

    data: bytes
    now: float
    damaged: bool


@dataclass(slots=True)
class _Runner:
    protocol: ProtocolModule
    decoder: Decoder[Any]
    frames: int = 0
    in_frames: int = 0  # bytes, since the first frame
    heard: int = 0

    def take(self, events: list[FrameReceived[Any] | Damaged]) -> None:
        for event in events:
            if isinstance(event, FrameReceived) and len(event.raw) >= LEAST_FRAME:
                self.frames += 1
                self.in_frames += len(event.raw)
            elif not self.frames:
                continue
            self.heard += len(event.raw)

    @property
    def sure(self) -> bool:
        return self.frames >= ENOUGH and self.in_frames >= SHARE * self.heard


class Telling:
    """Takes pieces until `protocol` is known; `kept` is what came before, for its decoder."""

    def __init__(self, protocols: Mapping[str, ProtocolModule]) -> None:
        self._protocols = protocols
        self.protocol: ProtocolModule | None = None
        self.kept: deque[Piece] = deque()
        self.heard = 0
        self._size = 0
        self._begin()

    def _begin(self) -> None:
        self._runners = [
            _Runner(protocol, protocol.decoder()) for protocol in self._protocols.values()
        ]

    def receive(self, piece: Piece) -> list[Piece]:
        """Take a piece; returns those that are too old to be kept."""
        self.kept.append(piece)
        self.heard += len(piece.data)
        self._size += len(piece.data)
        for runner in self._runners:
            decoder = runner.decoder
            error = decoder.line_error if piece.damaged else decoder.receive_data
            runner.take(error(piece.data))
        self._decide()
        if self.protocol is not None or self._size <= MOST_KEPT:
            return []
        return self._give_up()

    def silence(self) -> None:
        """The line fell silent: what is incomplete stays so."""
        for runner in self._runners:
            runner.take(runner.decoder.silence())
        self._decide()

    def _decide(self) -> None:
        sure = [runner for runner in self._runners if runner.sure]
        if sure:
            self.protocol = max(sure, key=lambda runner: runner.in_frames).protocol

    def _give_up(self) -> list[Piece]:
        """The older half; the race begins anew, so that a bad beginning costs nothing."""
        old = []
        while self._size > MOST_KEPT // 2:
            old.append(self.kept.popleft())
            self._size -= len(old[-1].data)
        self._begin()
        return old

    def finish(self) -> list[Piece]:
        """What nobody has understood."""
        left, self.kept = list(self.kept), deque()
        return left
