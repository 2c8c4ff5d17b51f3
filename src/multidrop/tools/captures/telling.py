"""A line whose protocol is not known yet: what comes is kept for the one that will be told."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from multidrop.device import ProtocolModule
from multidrop.tools.ears import Ear, Piece, told

ENOUGH = 3
"""Whole frames by which a protocol is told."""
MOST_KEPT = 16384
"""Bytes that are kept for the winner; older ones are given up as they are."""


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
        self._ears = [Ear(protocol, protocol.decoder()) for protocol in self._protocols.values()]

    def receive(self, piece: Piece) -> list[Piece]:
        """Take a piece; returns those that are too old to be kept."""
        self.kept.append(piece)
        self.heard += len(piece.data)
        self._size += len(piece.data)
        for ear in self._ears:
            ear.receive(piece.data, damaged=piece.damaged)
        self._decide()
        if self.protocol is not None or self._size <= MOST_KEPT:
            return []
        return self._give_up()

    def silence(self) -> None:
        """The line fell silent: what is incomplete stays so."""
        for ear in self._ears:
            ear.silence()
        self._decide()

    def _decide(self) -> None:
        ear = told(self._ears, ENOUGH)
        if ear is not None:
            self.protocol = ear.protocol

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
