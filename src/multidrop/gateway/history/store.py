"""What any store of history can be asked. SQLite and PostgreSQL differ in how they fetch, not in what comes.

All of it blocks; `part.py` calls it from threads.
"""

from __future__ import annotations

import sqlite3
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise

from multidrop.errors import UsageError
from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.blocks import Chunk
from multidrop.gateway.history.buckets import Bucketing, Summary
from multidrop.gateway.history.records import (
    CLOCK,
    GOOD,
    QUALITIES,
    STOPPED,
    Batch,
    Bucket,
    Sample,
    whole,
)
from multidrop.profile import nearest

MOST_BUCKETS = 2000

CARRIED = 2 * 3600 * 1_000_000
"""µs before a range in which the value that held when it began is looked for."""

SEAL_ALL, SEAL_ONE = 200_000, 4096
"""Fresh samples of all points, or of one, after which all of them are put into blocks."""

FORGET_AT_ONCE = 200
"""Blocks of one point that are forgotten with one writing."""

KILLED, NOT_RUNNING = "the gateway ended without being stopped", "the gateway was not running"


@dataclass(frozen=True, slots=True)
class StoredSpan:
    """A span as it is stored: whole up to `until`, and how it ended."""

    key: int
    start: int
    until: int
    shift: int
    synchronised: bool | None
    ended: str


@dataclass(frozen=True, slots=True)
class StoreState:
    """How a store is. `hours`: how long its server may be away at the present rate, None without one."""

    error: str | None = None
    waiting: int = 0
    hours: float | None = None


class Store(ABC):
    """Batches in, samples and buckets out. Writing and asking may be done by two threads.

    `failures` is what the database raises when it cannot.
    """

    failures: tuple[type[Exception], ...] = (sqlite3.Error, OSError)

    @property
    def left(self) -> float | None:
        """How much longer the server may be away, h, with what waits for it already; None without one."""
        return None

    @abstractmethod
    def write(self, batches: Sequence[Batch], forget: int | None = None) -> None:
        """Take batches: all of them or none. Then forget some of what is older than `forget`.

        A batch that comes again is taken once. Raises one of `failures` where nothing was taken.
        """

    @abstractmethod
    def close(self) -> None: ...

    @property
    def state(self) -> StoreState:
        return StoreState()

    @property
    def delivered(self) -> bool:
        """Whether everything that was written can be asked for."""
        return True

    # -- what a store fetches ------------------------------------------------------------------

    @abstractmethod
    def _snapshot(self) -> None:
        """From here on, until `_done`, everything is fetched as it is now."""

    @abstractmethod
    def _done(self) -> None: ...

    @abstractmethod
    def _points(self) -> list[tuple[str, str]]:
        """Device and point of everything there is, in order."""

    @abstractmethod
    def _key(self, device: str, point: str) -> int | None: ...

    @abstractmethod
    def _spans(self) -> list[StoredSpan]:
        """In the order in which they happened."""

    @abstractmethod
    def _losses(self, start: int, end: int) -> list[Gap]: ...

    @abstractmethod
    def _chunks(self, series: int, span: int, start: int, end: int) -> Generator[Chunk, None, None]:
        """All chunks that have samples in `start` <= time < `end`, in order."""

    @abstractmethod
    def _pieces(
        self, series: int, span: int, start: int, end: int, width: int
    ) -> Generator[Chunk | Summary, None, None]:
        """The same, with a summary where a chunk is within one of the buckets."""

    @abstractmethod
    def _newest(
        self, series: int, span: int | None, before: int | None
    ) -> tuple[int, Chunk] | None:
        """The last sample, of this span and before this time where they are given, and its span."""

    # -- what people ask -----------------------------------------------------------------------

    def series(self) -> list[tuple[str, str]]:
        """Device and point of everything there is."""
        self._snapshot()
        try:
            return self._points()
        finally:
            self._done()

    def latest(self, device: str, point: str) -> Sample | None:
        """The newest sample; None where there is none. Raises `UsageError` for an unknown point."""
        self._snapshot()
        try:
            found = self._newest(self._known(device, point), None, None)
            if found is None:
                return None
            key, chunk = found
            span = next(span for span in self._spans() if span.key == key)
            return next(_samples(device, point, span, [chunk]))
        finally:
            self._done()

    def range(self, device: str, point: str, start: int, end: int) -> Generator[Sample, None, None]:
        """All samples in `start` <= time < `end`, in the order in which they happened; close it."""
        self._snapshot()
        try:
            series = self._known(device, point)
            for span in _overlapping(self._spans(), start, end):
                with closing(self._chunks(series, span.key, start, end)) as chunks:
                    for sample in _samples(device, point, span, chunks):
                        if start <= sample.time < end:
                            yield sample
        finally:
            self._done()

    def buckets(
        self, device: str, point: str, start: int, end: int, most: int = MOST_BUCKETS
    ) -> list[Bucket]:
        """What was in `start` <= time < `end`, in at most `most` (1..2000) equal buckets."""
        if not 1 <= most <= MOST_BUCKETS:
            raise UsageError(f"{most} buckets are out of range: 1..{MOST_BUCKETS}")
        if end <= start:
            raise UsageError("a range of time ends after it starts")
        self._snapshot()
        try:
            series = self._known(device, point)
            bucketing = Bucketing(start, end, most)
            spans = self._spans()
            overlapping = _overlapping(spans, start, end)
            for span in overlapping:
                pieces = self._pieces(series, span.key, start, end, bucketing.width)
                with closing(pieces):  # else nothing else could be asked, if this went wrong
                    bucketing.add(pieces)
            bucketing.before(self._carried(device, point, series, start, overlapping))
            bucketing.missing(self._gaps(spans, start, end))
            return bucketing.result()
        finally:
            self._done()

    def gaps(self, start: int, end: int) -> list[Gap]:
        """Where nothing was recorded, or recorded samples were lost."""
        self._snapshot()
        try:
            return self._gaps(self._spans(), start, end)
        finally:
            self._done()

    # -- how -------------------------------------------------------------------------------------

    def _known(self, device: str, point: str) -> int:
        found = self._key(device, point)
        if found is None:
            known = [f"{one} {other}" for one, other in self._points()]
            wanted = f"{device} {point}"
            raise UsageError(f"there is no history of {wanted}{nearest(wanted, known)}")
        return found

    def _carried(
        self, device: str, point: str, series: int, start: int, spans: Sequence[StoredSpan]
    ) -> Sample | None:
        for span in reversed(spans):
            if span.start <= start:
                found = self._newest(series, span.key, start)
                if found is not None and found[1].times[0] >= start - CARRIED:
                    return next(_samples(device, point, span, [found[1]]))
                return None
        return None

    def _gaps(self, spans: Sequence[StoredSpan], start: int, end: int) -> list[Gap]:
        between = [
            Gap(
                earlier.until,
                max(earlier.until, later.start),
                NOT_RUNNING if earlier.ended == STOPPED else KILLED,
            )
            for earlier, later in pairwise(spans)
            if earlier.ended != CLOCK
        ]
        within = [gap for gap in between if gap.start < end and gap.end >= start]
        return sorted([*within, *self._losses(start, end)], key=lambda gap: gap.start)


def _overlapping(spans: Sequence[StoredSpan], start: int, end: int) -> list[StoredSpan]:
    return [span for span in spans if span.start < end and span.until >= start]


def _samples(
    device: str, point: str, span: StoredSpan, chunks: Iterable[Chunk]
) -> Iterator[Sample]:
    for chunk in chunks:
        codes = chunk.codes or bytes([GOOD]) * len(chunk.times)
        for time, value, code in zip(chunk.times, chunk.values, codes, strict=True):
            yield Sample(
                device,
                point,
                time,
                (time - span.shift) / 1e6,
                span.synchronised,
                whole(value) if isinstance(value, float) else value,
                QUALITIES[code],
            )
