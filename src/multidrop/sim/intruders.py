"""Ends of a wire that spoil it: a second master, and devices at another setting."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from multidrop.io.memory import Peer
from multidrop.sim.misread import Setting, misread


class OtherMaster:
    """A line on which another master speaks too: `said` in turn, one every `every` s from `first` on.

    What it says is heard at once, and takes its time only on the way to the devices of
    the line. Whatever it hears from them, this side hears as well.
    """

    def __init__(
        self,
        line: Peer,
        said: Sequence[bytes],
        every: float,
        *,
        first: float = 0.0,
        unanswered: bool = False,
    ) -> None:
        self._line = line
        self._said = deque(said)
        self._every = every
        self._next = first
        self._unanswered = unanswered

    def receive(self, data: bytes, now: float) -> None:
        self._line.receive(data, now)

    @property
    def deadline(self) -> float:
        return min(self._line.deadline, self._next)

    def send(self, now: float) -> bytes:
        heard = self._line.send(now)
        if now < self._next:
            return heard
        said = self._said[0]
        self._said.rotate(-1)
        self._next = now + self._every
        if not self._unanswered:
            self._line.receive(said, now)
        return heard + said


class OtherSetting:
    """A line whose devices send at `sent`, while this side listens at `heard`; byte by byte.

    They understand this side all the same, unless they are `deaf`: a format that
    differs only in its parity is often understood, another baud rate never.
    """

    def __init__(
        self,
        line: Peer,
        sent: Setting,
        heard: Setting,
        *,
        inverted: bool = False,
        marks: bool = False,
        deaf: bool = False,
    ) -> None:
        self._line = line
        self._settings = sent, heard
        self._inverted = inverted
        self._marks = marks
        self._deaf = deaf

    def receive(self, data: bytes, now: float) -> None:
        if not self._deaf:
            self._line.receive(data, now)

    @property
    def deadline(self) -> float:
        return self._line.deadline

    def send(self, now: float) -> bytes:
        """As a port delivers it; with `marks` as one that marks wrong bytes (PARMRK)."""
        data = self._line.send(now)
        if not data:
            return b""
        out = bytearray()
        for byte, _, wrong in misread(data, *self._settings, inverted=self._inverted):
            if self._marks and wrong:
                out += bytes((0xFF, 0, byte))
            elif self._marks and byte == 0xFF:
                out += b"\xff\xff"
            else:
                out.append(byte)
        return bytes(out)


__all__ = ["OtherMaster", "OtherSetting"]
