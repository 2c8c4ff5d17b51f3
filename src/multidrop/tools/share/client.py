"""One master of a shared line: its bytes become frames, and what is said of it stays bearable."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any, Protocol

from multidrop.events import FrameReceived
from multidrop.io.listen import Caller
from multidrop.relay import Recognition

LINES_PER_SECOND, LINES_AT_ONCE = 5.0, 20.0
"""Of one client, about what it may not do: it cannot fill a disk with them."""


class Room(Protocol):
    """What a client needs of the line that it shares."""

    silence: float
    """s without a byte that cut a client's frame short."""

    def put(self, client: Client, frame: Any) -> None:
        """A whole frame came."""
        ...

    def left(self, client: Client) -> None: ...
    def hang_up(self, client: Client, why: str) -> None: ...


@dataclass(slots=True)
class Counts:
    """What happened since the start."""

    clients: int = 0
    requests: int = 0  # that went on the line
    answers: int = 0
    refused: int = 0  # writes
    dropped: int = 0  # frames of clients that flooded, or of a time without a port

    def shown(self) -> str:
        """For a person; what did not happen is left out."""
        parts = [_counted(self.requests, "request"), _counted(self.answers, "answer")]
        if self.clients:
            parts.insert(0, _counted(self.clients, "client"))
        if self.refused:
            parts.append(_counted(self.refused, "write") + " refused")
        if self.dropped:
            parts.append(_counted(self.dropped, "frame") + " dropped")
        return ", ".join(parts)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


class Client:
    """One master: its bytes become frames, its frames wait for the line."""

    def __init__(self, room: Room, caller: Caller, recognition: Recognition) -> None:
        self.name = caller.name
        self.counts = Counts()
        self.gone = False
        self.paused = False
        self._room = room
        self._caller = caller
        self._recognition = recognition
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._lines = LINES_AT_ONCE
        self._lines_at = self._loop.time()

    @property
    def protocol(self) -> str | None:
        return self._recognition.protocol

    def receive(self, data: bytes) -> None:
        self._take(self._recognition.receive_data(data))
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._recognition.pending and not self.gone:
            self._timer = self._loop.call_later(self._room.silence, self._fell_silent)

    def _fell_silent(self) -> None:
        self._timer = None
        self._take(self._recognition.silence())

    def _take(self, events: list[Any]) -> None:
        if self._recognition.hopeless:
            self._room.hang_up(self, "sends no frame of a protocol that is known here")
            return
        for event in events:
            if isinstance(event, FrameReceived) and not self.gone:
                self._room.put(self, event.frame)

    def write(self, raw: bytes) -> None:
        if not self.gone:
            self._caller.write(raw)

    def pause(self, paused: bool) -> None:
        """Read no more from it while its frames wait."""
        if paused != self.paused and not self.gone:
            self.paused = paused
            (self._caller.pause if paused else self._caller.resume)()

    def may_be_told_of(self) -> bool:
        """Whether one more line about it is not too many."""
        now = self._loop.time()
        self._lines = min(LINES_AT_ONCE, self._lines + (now - self._lines_at) * LINES_PER_SECOND)
        self._lines_at = now
        if self._lines < 1:
            return False
        self._lines -= 1
        return True

    def hang_up(self) -> None:
        self.pause(False)
        self._caller.hang_up()

    def close(self) -> None:
        """It has gone."""
        if self.gone:
            return
        self.gone = True
        if self._timer is not None:
            self._timer.cancel()
        self._room.left(self)
