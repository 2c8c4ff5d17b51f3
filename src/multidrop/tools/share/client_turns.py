"""Whose frame goes on a shared line next. No clock and no loop in here."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

ClientT = TypeVar("ClientT", bound=Hashable)

MOST = 16
"""Frames of one client that wait. A master asks one thing at a time: who sends more is flooding."""


@dataclass(slots=True)
class Waiting(Generic[ClientT]):
    """A frame that waits for the line since some time."""

    client: ClientT
    frame: Any
    since: float


@dataclass(frozen=True, slots=True)
class Hold(Generic[ClientT]):
    """The line is one client's, for the sake of a frame of it, until some time."""

    client: ClientT
    frame: Any
    until: float


class ClientTurns(Generic[ClientT]):
    """One frame of each client in turn; of one alone while it holds the line.

    What waited for more than `patience` s is not sent any more: its master has
    given it up, and may have decided something else since.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self.hold: Hold[ClientT] | None = None
        self._queues: dict[ClientT, deque[Waiting[ClientT]]] = {}  # the next client first

    def join(self, client: ClientT) -> None:
        self._queues[client] = deque()

    def leave(self, client: ClientT, now: float) -> None:
        """The client has gone, and with it what it waited for and its hold."""
        del self._queues[client]
        if self.hold is not None and self.hold.client == client:
            self.hold = Hold(client, self.hold.frame, now)

    def put(self, client: ClientT, frame: Any, now: float, *, once: bool = False) -> bool:
        """Queue a frame; False where its client has too many already.

        With `once` it takes the place of the same frame that still waits: its
        master asks again, and whoever it asks must hear it once.
        """
        queue = self._queues[client]
        while queue and now - queue[0].since > self.patience:
            queue.popleft()
        if once:
            for waiting in queue:
                if waiting.frame.numbered(0) == frame.numbered(0):
                    waiting.frame, waiting.since = frame, now
                    return True
        if len(queue) >= MOST:
            return False
        queue.append(Waiting(client, frame, now))
        return True

    def waiting(self, client: ClientT) -> int:
        """How many frames of a client wait."""
        return len(self._queues[client])

    def take(self, now: float) -> Waiting[ClientT] | None:
        """The next frame for the line, None if there is none that may go now."""
        holder = self.hold.client if self.hold is not None else None
        for client, queue in self._queues.items():
            if holder is not None and client != holder:
                continue
            while queue and now - queue[0].since > self.patience:
                queue.popleft()
            if queue:
                found = queue.popleft()
                self._queues[client] = self._queues.pop(client)  # behind the others
                return found
        return None

    def clear(self) -> None:
        """Forget all that waits."""
        for queue in self._queues.values():
            queue.clear()
        self.hold = None
