"""Listens to a line that others speak on. Never sends a byte."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from multidrop.device import ProtocolModule
from multidrop.events import Damaged
from multidrop.io.capture import CaptureWriter, Known, write_cut
from multidrop.io.cutting import Cut, Cutter, WallClock
from multidrop.io.ports import Port
from multidrop.observer import Found, Observer
from multidrop.protocols import PROTOCOLS
from multidrop.timing import LineSettings
from multidrop.tools.captures.listened import Listened
from multidrop.tools.captures.telling import Telling
from multidrop.tools.ears import Piece

POLL = 0.25
"""s without a byte after which somebody may look at something else."""

GARBAGE = 512
"""Bytes without a frame of any protocol, after which the settings are in doubt."""


class Heard(NamedTuple):
    """What was found on which line."""

    line: Listened | None
    found: Found


class Sniffer:
    """One passive line. `settings` are those of the port; `listened` makes the line of a protocol.

    `garbage` is called, again after each `GARBAGE` bytes, with how many bytes
    were heard without understanding any.
    """

    def __init__(
        self,
        port: Port,
        name: str,
        settings: LineSettings,
        protocol: ProtocolModule | None,
        listened: Callable[[ProtocolModule], Listened],
        *,
        writer: CaptureWriter | None = None,
        garbage: Callable[[int], None] = lambda count: None,
    ) -> None:
        self._port = port
        self._name = name
        self._settings = settings
        self._listened = listened
        self._writer = writer
        self._garbage = garbage
        self._raw_line: int | None = None
        self._told = Telling(PROTOCOLS) if protocol is None else None
        self._misunderstood = 0
        self._last = 0.0
        self.heard = 0  # bytes
        self.wall = WallClock()
        self.line: Listened | None = None
        if protocol is not None:
            self._begin(protocol)

    def _begin(self, protocol: ProtocolModule) -> None:
        self.line = self._listened(protocol)
        self._cutter = Cutter(self.line.settings, network=self._port.network, passive=True)
        self._observer: Observer = self.line.observer(network=self._port.network)
        if self._writer is not None:
            devices = [
                Known(address, profile.name, self.line.names.get(address, ""))
                for address, profile in self.line.profiles.items()
            ]
            self._number = self._writer.add_line(
                protocol, self.line.settings, self._name, devices, self.line.own
            )

    def run(self) -> Iterator[list[Heard]]:
        """What is heard, as it comes; an empty list now and then. Raises `PortError`."""
        port = self._port
        while True:
            data = port.read(max(min(self._deadline - port.now(), POLL), 0.0))
            now = port.now()
            if not data:
                yield self._time_passed(now)
                continue
            marks = port.marks
            pieces = [(data, False)] if marks is None else marks.split(data)
            heard: list[Heard] = []
            for piece, damaged in pieces:
                heard += self._receive(Piece(piece, now, damaged))
            yield heard

    def finish(self) -> list[Heard]:
        """What was not complete when it ended; the rest of the capture is written."""
        if self.line is None:
            assert self._told is not None
            self._write_raw(self._told.finish())
            return []
        found = self._take(self._cutter.finish())
        return found + [Heard(self.line, item) for item in self._observer.finish()]

    @property
    def _deadline(self) -> float:
        if self.line is None:
            return self._last + POLL
        return min(self._cutter.deadline, self._observer.deadline)

    def _time_passed(self, now: float) -> list[Heard]:
        if self.line is None:
            assert self._told is not None
            if now - self._last >= self._settings.timing(network=self._port.network).silence:
                self._told.silence()
                return self._tell()
            return []
        heard = self._take(self._cutter.time_passed(now))
        return heard + [Heard(self.line, item) for item in self._observer.time_passed(now)]

    def _receive(self, piece: Piece) -> list[Heard]:
        self._last = piece.now
        self.heard += len(piece.data)
        if self.line is not None:
            return self._understand(piece)
        assert self._told is not None
        self._write_raw(self._told.receive(piece))
        heard = self._tell()
        if self.line is None:
            self._count_garbage(len(piece.data))
        return heard

    def _tell(self) -> list[Heard]:
        """Begin with the protocol that was told, and let it have what came before."""
        assert self._told is not None
        if self._told.protocol is None:
            return []
        self._begin(self._told.protocol)
        self._misunderstood = 0
        heard: list[Heard] = []
        for piece in self._told.finish():
            heard += self._understand(piece)
        return heard

    def _understand(self, piece: Piece) -> list[Heard]:
        cuts = self._cutter.receive(piece.data, piece.now, damaged=piece.damaged)
        return self._take(cuts)

    def _take(self, cuts: list[Cut]) -> list[Heard]:
        assert self.line is not None
        heard = []
        for cut in cuts:
            if self._writer is not None:
                write_cut(self._writer, self._number, cut, self.wall(cut.end))
            if isinstance(cut.event, Damaged):
                self._count_garbage(len(cut.event.raw))
            else:
                self._misunderstood = 0
            for item in self._observer.frame(cut.event, cut.end, cut.sent):
                heard.append(Heard(self.line, item))
        return heard

    def _count_garbage(self, count: int) -> None:
        before = self._misunderstood // GARBAGE
        self._misunderstood += count
        if self._misunderstood // GARBAGE > before:
            self._garbage(self._misunderstood)

    def _write_raw(self, pieces: list[Piece]) -> None:
        """Bytes of no known protocol, in pieces as they came."""
        if self._writer is None or not pieces:
            return
        if self._raw_line is None:
            self._raw_line = self._writer.add_line(None, self._settings, self._name)
        for piece in pieces:
            damage = "parity or framing error" if piece.damaged else ""
            time_ns = self.wall(piece.now)
            self._writer.add(
                self._raw_line, piece.data, time_ns, damage=damage, marked=piece.damaged
            )
