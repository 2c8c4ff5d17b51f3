"""What is missing, said as a record of its own. Pure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Gap:
    """Something is missing between two times, in microseconds since 1970 UTC. `samples` is how many, where that is known."""

    start: int
    end: int
    reason: str
    samples: int | None = None
