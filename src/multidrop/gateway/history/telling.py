"""What history tells of itself. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

from multidrop.gateway.telling import Metric, Trouble, full


@dataclass(frozen=True, slots=True)
class HistoryState:
    """How history is kept now. `error`: why nothing can be written, None where all is well.

    `waiting` samples are not in the store yet; `lost` ones had to be given up in this run.
    `hours`: how long the database server may be away at the present rate; None without one.
    """

    error: str | None
    waiting: int
    lost: int
    hours: float | None


def metrics_of(state: HistoryState) -> Iterator[Metric]:
    yield Metric(
        "history_up", "gauge", "whether history is being written", float(state.error is None)
    )
    yield Metric(
        "history_waiting_samples",
        "gauge",
        "samples that are not in the database yet",
        state.waiting,
    )
    yield Metric(
        "history_lost_samples_total", "counter", "samples that had no room to wait", state.lost
    )
    yield Metric(
        "history_outbox_hours",
        "gauge",
        "how long the database server may be away at the present rate",
        state.hours,
    )


def trouble_of(
    state: HistoryState, since: datetime, left: float | None, *, waits: bool
) -> Trouble | None:
    """`waits` is whether samples are on a disk until the database is back; `left` for how many hours more."""
    if state.error is None:
        return None
    if waits:
        room = "; there is no room for more, so the oldest go" if full(left) else ""
        text = (
            f"The database does not take the history: {state.error}. "
            f"{state.waiting:,} samples wait on the disk{room}."
        )
        return Trouble(text, since, losing=full(left), hours=left)
    lost = f"; {state.lost:,} had no room and are lost" if state.lost else ""
    text = (
        f"History is not recorded: {state.error}. {state.waiting:,} samples wait in memory{lost}."
    )
    return Trouble(text, since, losing=True)
