"""Samples on their way to a store: cut into spans and batches, and bounded while it takes none.

Pure.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.records import (
    CLOCK,
    CODES,
    RUNNING,
    STOPPED,
    Batch,
    Row,
    Sample,
    Span,
)

STEP = 100_000
"""µs by which wall time may stray from monotonic time before it is said to have stepped."""

MOST_WAITING = 100_000
"""Samples that wait in memory while nothing can be written; the oldest go first."""

SETTLED = 3600 * 1_000_000
"""µs after a step, or the start, until wall time is believed where something is to be forgotten."""

HEARTBEAT = 10.0
"""s after which it is recorded that nothing had to be."""


class Batching:
    """The samples of one run of the gateway, in the order in which they came.

    `run` names the run, and is never used again. A sample's time is its monotonic time and its
    span's shift, so that it rises as long as wall time only creeps.
    """

    def __init__(self, run: str, most: int = MOST_WAITING) -> None:
        self.lost = 0
        self._run = run
        self._most = most
        self._number = 0
        self._span: Span | None = None
        self._spans = 0
        self._until = 0
        self._closed = float("-inf")
        self._rows: list[Row] = []
        self._last: dict[tuple[str, str], int] = {}
        self._waiting: deque[Batch] = deque()

    @property
    def samples(self) -> int:
        """How many wait."""
        return len(self._rows) + sum(len(batch.rows) for batch in self._waiting)

    @property
    def settled(self) -> int | None:
        """The newest time (µs); None where wall time stepped lately, and may be wrong."""
        if self._span is None or self._until - self._span.start < SETTLED:
            return None
        return self._until

    def take(self, samples: Iterable[Sample]) -> None:
        """In the order in which they happened."""
        for sample in samples:
            device, point, wall, seconds, synchronised, value, quality = sample
            monotonic = round(seconds * 1e6)
            span = self._span
            if (
                span is None
                or synchronised is not span.synchronised
                or not -STEP <= wall - monotonic - span.shift <= STEP
            ):
                span = self._begin(sample, wall - monotonic)
            key = device, point
            time = monotonic + span.shift
            last = self._last.get(key, 0)
            if time <= last:
                time = last + 1
            self._last[key] = time
            if time > self._until:
                self._until = time
            self._rows.append(Row(device, point, time, value, CODES[quality]))

    def cut(self, monotonic: float, *, stop: bool = False) -> list[Batch]:
        """All batches that wait, what came until now (s) included. They wait until `written`."""
        silent = monotonic - self._closed >= HEARTBEAT and not self._waiting
        if self._span is not None and (self._rows or stop or silent):
            self._closed = monotonic
            self._until = max(self._until, round(monotonic * 1e6) + self._span.shift)
            self._close(STOPPED if stop else RUNNING)
            if stop:
                self._span = None
        self._bound()
        return list(self._waiting)

    def written(self, batches: int) -> None:
        """The first so many of them are in the store."""
        for _ in range(batches):
            self._waiting.popleft()

    def _begin(self, sample: Sample, shift: int) -> Span:
        if self._span is not None:
            self._close(CLOCK)
        self._spans += 1
        self._span = Span(self._run, self._spans, sample.time, shift, sample.synchronised)
        self._until = sample.time
        self._last.clear()
        return self._span

    def _close(self, ended: str) -> None:
        assert self._span is not None
        self._number += 1
        self._waiting.append(Batch(self._number, self._span, self._until, ended, self._rows))
        self._rows = []

    def _bound(self) -> None:
        """The oldest go, and the next one says so."""
        rows = sum(len(batch.rows) for batch in self._waiting)
        while rows > self._most and len(self._waiting) > 1:
            oldest = self._waiting.popleft()
            rows -= len(oldest.rows)
            self.lost += len(oldest.rows)
            lost = merged(oldest, "nothing could be written")
            self._waiting[0] = replace(self._waiting[0], lost=lost)


def merged(batch: Batch, reason: str) -> tuple[Gap, ...]:
    """What is lost where a batch is: its rows, and what it was to tell of earlier losses."""
    if not batch.rows:
        return batch.lost
    first = min(row.time for row in batch.rows)
    last = max(row.time for row in batch.rows)
    samples = len(batch.rows)
    *others, before = batch.lost or (None,)
    if before is not None and before.reason == reason and before.end <= last:
        return (*filter(None, others), _joined(before, last, samples))
    return (*batch.lost, Gap(first, last, reason, samples))


def _joined(gap: Gap, end: int, samples: int) -> Gap:
    return replace(gap, end=end, samples=(gap.samples or 0) + samples)
