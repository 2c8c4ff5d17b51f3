"""A time range as equal buckets, for charts: smallest, largest and last value, and where there is none.

Pure.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.blocks import Chunk, quiet
from multidrop.gateway.history.records import GOOD, Bucket, Kept, Sample, whole
from multidrop.io.poller import Quality


class Contents(NamedTuple):
    """What samples come to. `minimum` None: there are no numbers. `good`: how many have a value.

    `gap`: some have none.
    """

    minimum: int | float | None
    maximum: int | float | None
    last: Kept
    good: int
    gap: bool


class Summary(NamedTuple):
    """A stretch of samples, from `first` (µs) on, that all are in one bucket."""

    first: int
    contents: Contents


class Bucketing:
    """Collects what is in `start` <= time < `end` (µs), in `most` buckets or fewer."""

    def __init__(self, start: int, end: int, most: int) -> None:
        self.start = start
        self.end = end
        self.width = max(1, -(-(end - start) // most))
        self._found: dict[int, Bucket] = {}

    def add(self, pieces: Iterable[Chunk | Summary]) -> None:
        """The next samples, all of one span, in the order in which they happened."""
        for piece in pieces:
            if isinstance(piece, Summary):
                self._merge((piece.first - self.start) // self.width, piece.contents)
            else:
                self._cut(piece)

    def before(self, sample: Sample | None) -> None:
        """What held when the range began, where nothing was in the first bucket."""
        if sample is None or 0 in self._found:
            return
        good = sample.quality is Quality.GOOD and sample.value is not None
        value = sample.value if good else None
        number = value if isinstance(value, int | float) else None
        self._found[0] = Bucket(self.start, number, number, value, 0, not good)

    def missing(self, gaps: Iterable[Gap]) -> None:
        """Where nothing was recorded at all."""
        for gap in gaps:
            if gap.start < self.end and gap.end >= self.start:
                number = (max(gap.start, self.start) - self.start) // self.width
                self._merge(number, Contents(None, None, None, 0, True))

    def result(self) -> list[Bucket]:
        """By time; those with nothing in them are left out."""
        return [self._found[number] for number in sorted(self._found)]

    def _cut(self, chunk: Chunk) -> None:
        """Into what is in each bucket."""
        times, values = chunk.times, chunk.values
        codes = None if quiet(chunk.codes) else chunk.codes
        at = bisect_left(times, self.start)
        stop = bisect_left(times, self.end)
        while at < stop:
            number = (times[at] - self.start) // self.width
            upto = bisect_left(times, self.start + (number + 1) * self.width, at, stop)
            some = None if codes is None else codes[at:upto]
            self._merge(number, contents_of(values[at:upto], some, plain=chunk.plain))
            at = upto

    def _merge(self, number: int, later: Contents) -> None:
        minimum, maximum, last, count, gap = later
        earlier = self._found.get(number)
        if earlier is not None:
            minimum = _one_of(min, earlier.minimum, minimum)
            maximum = _one_of(max, earlier.maximum, maximum)
            last = last if count else earlier.last
            count += earlier.count
            gap = gap or earlier.gap
        if isinstance(last, float):
            last = whole(last)
        time = self.start + number * self.width
        self._found[number] = Bucket(time, whole(minimum), whole(maximum), last, count, gap)


def contents_of(values: Sequence[Kept], codes: Sequence[int] | None, *, plain: bool) -> Contents:
    """What these come to, at least one; `codes` and `plain` as in a `Chunk`."""
    if plain and quiet(codes):
        known: Any = values  # numbers, as `plain` says
        return Contents(min(known), max(known), known[-1], len(known), False)
    good = [
        value
        for place, value in enumerate(values)
        if value is not None and (codes is None or codes[place] == GOOD)
    ]
    numbers = [value for value in good if isinstance(value, int | float)]
    return Contents(
        min(numbers, default=None),
        max(numbers, default=None),
        good[-1] if good else None,
        len(good),
        len(good) < len(values),
    )


def _one_of(
    choose: Callable[[float, float], float], one: float | None, other: float | None
) -> float | None:
    if one is None or other is None:
        return other if one is None else one
    return choose(one, other)
