"""What a part of the gateway tells of itself: the same to `/api/status`, `/health`, the page and metrics. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import Any, NamedTuple, Protocol, runtime_checkable

NO_ROOM = 1 / 30
"""h of room that are as good as none: an outbox that is full has always a little."""


class Metric(NamedTuple):
    """One number of a part; None is not shown. `name` begins with the part's."""

    name: str
    kind: str
    meaning: str
    value: float | None


@dataclass(frozen=True, slots=True)
class Trouble:
    """Something is not recorded or not delivered now: a sentence for people, since when (UTC).

    `losing` is whether what comes now is not safe: it is lost, or is when the gateway ends. Else
    it waits, and there is room for `hours` more at the present rate; None where nobody knows.
    """

    text: str
    since: datetime
    losing: bool
    hours: float | None = None


@runtime_checkable
class Telling(Protocol):
    """A part that has something to tell. `state` is a dataclass, which `/api/status` has under its name."""

    name: str

    @property
    def state(self) -> Any: ...

    @property
    def trouble(self) -> Trouble | None: ...

    def metrics(self) -> Iterable[Metric]: ...


def full(left: float | None) -> bool:
    """Whether an outbox with room for so many hours gives up the oldest."""
    return left is not None and left < NO_ROOM
