"""Follows the lines of a capture: packets in, transactions out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from multidrop.device import ProtocolModule
from multidrop.events import Damaged
from multidrop.io.captured import Packet
from multidrop.observer import Found, Observer
from multidrop.tools.captures.listened import Listened
from multidrop.tools.captures.telling import Telling
from multidrop.tools.ears import Piece
from multidrop.transaction import Damage


class Follower(Protocol):
    """One line of a capture. `line` is None while its protocol is not known."""

    line: Listened | None

    def packet(self, packet: Packet, end: float) -> list[Found]:
        """What a packet completes whose last byte had passed at `end`."""
        ...

    def finish(self) -> list[Found]:
        """Nothing more comes, or the clock was set: what is open comes out."""
        ...


class FrameFollower:
    """A line whose packets are frames."""

    def __init__(self, line: Listened) -> None:
        self.line: Listened | None = line
        self._observer = line.observer()
        self._decoder = line.settings.decoder()

    def packet(self, packet: Packet, end: float) -> list[Found]:
        data, _, flags, comment, _ = packet
        sent = None
        if flags:
            sent = packet.sent
            if packet.damaged:
                return self._observer.frame(Damaged(data, comment or "damaged"), end, sent)
        decoder = self._decoder
        events = decoder.receive_data(data)
        if decoder.held:
            events = [*events, *decoder.silence()]
        if len(events) == 1:
            return self._observer.frame(events[0], end, sent)
        found: list[Found] = []
        for event in events:  # of a writer that has another opinion of what a frame is
            found += self._observer.frame(event, end, sent)
        return found

    def finish(self) -> list[Found]:
        return self._observer.finish()


class RawFollower:
    """A line of bytes whose protocol has to be told first."""

    def __init__(
        self,
        listened: Callable[[ProtocolModule], Listened],
        among: Mapping[str, ProtocolModule],
    ) -> None:
        self._listened = listened
        self._told = Telling(among)
        self.line: Listened | None = None
        self._observer: Observer | None = None

    def packet(self, packet: Packet, end: float) -> list[Found]:
        piece = Piece(packet.data, end, packet.damaged)
        if self._observer is not None:
            return self._observer.receive_data(piece.data, end, damaged=piece.damaged)
        old = self._told.receive(piece)
        if self._told.protocol is None:
            return [_not_understood(piece) for piece in old]
        self.line = self._listened(self._told.protocol)
        observer = self._observer = self.line.observer()
        found: list[Found] = []
        for piece in self._told.finish():
            found += observer.receive_data(piece.data, piece.now, damaged=piece.damaged)
        return found

    def finish(self) -> list[Found]:
        if self._observer is not None:
            return self._observer.finish()
        return [_not_understood(piece) for piece in self._told.finish()]


def _not_understood(piece: Piece) -> Damage:
    return Damage(piece.data, "no known protocol", piece.now)
