"""A time range as equal buckets, for charts: smallest, largest and last value, and where there is none.

Pure.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.blocks import Chunk, quiet
from multidrop.gateway.history.records import GOOD, Bucket, Kept, Sample, whole
from multidrop.io.poller import Quality


@dataclass(frozen=True, slots=True)
class Summary:
    """A stretch of samples that all are in one bucket. `minimum` None: no numbers among them."""

    first: int
    count: int
    minimum: int | float | None
    maximum: int | float | None
    last: Kept
    gap: bool


class Bucketing:
    """Collects what is in `start` <= time < `end` (µs), in `most` buckets or fewer."""

    def __init__(self, start: int, end: int, most: int) -> None:
        self.start = start
        self.end = end
        self.width = max(1, -(-(end - start) // most))
        self._found: dict[int, Bucket] = {}

    def add(self, piece: Chunk | Summary) -> None:
        """The next samples, in the order in which they happened."""
        if isinstance(piece, Summary):
            self._merge(
                (piece.first - self.start) // self.width,
                piece.minimum,
                piece.maximum,
                piece.last,
                piece.count,
                piece.gap,
            )
            return
        times = piece.times
        at = bisect_left(times, self.start)
        stop = bisect_left(times, self.end)
        while at < stop:
            number = (times[at] - self.start) // self.width
            upto = bisect_left(times, self.start + (number + 1) * self.width, at, stop)
            self._segment(number, piece, at, upto)
            at = upto

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
                self._merge(number, None, None, None, 0, True)

    def result(self) -> list[Bucket]:
        """By time; those with nothing in them are left out."""
        return [self._found[number] for number in sorted(self._found)]

    def _segment(self, number: int, chunk: Chunk, at: int, upto: int) -> None:
        values: Sequence[Kept] = chunk.values[at:upto]
        codes = None if chunk.codes is None else chunk.codes[at:upto]
        self._merge(number, *summary_of(values, codes, plain=chunk.plain))

    def _merge(
        self,
        number: int,
        minimum: int | float | None,
        maximum: int | float | None,
        last: Kept,
        count: int,
        gap: bool,
    ) -> None:
        old = self._found.get(number)
        if old is not None:
            minimum = _one_of(min, old.minimum, minimum)
            maximum = _one_of(max, old.maximum, maximum)
            last = last if count else old.last
            count += old.count
            gap = gap or old.gap
        time = self.start + number * self.width
        self._found[number] = Bucket(time, minimum, maximum, last, count, gap)


def summary_of(
    values: Sequence[Kept], codes: Sequence[int] | None, *, plain: bool
) -> tuple[int | float | None, int | float | None, Kept, int, bool]:
    """Minimum, maximum, last, count, and whether there are marks among them."""
    if plain and quiet(codes):
        return (
            whole(min(values)),  # type: ignore[type-var, arg-type]
            whole(max(values)),  # type: ignore[type-var, arg-type]
            _tidy(values[-1]),
            len(values),
            False,
        )
    good = [
        value
        for place, value in enumerate(values)
        if value is not None and (codes is None or codes[place] == GOOD)
    ]
    numbers = [value for value in good if isinstance(value, int | float)]
    return (
        whole(min(numbers, default=None)),
        whole(max(numbers, default=None)),
        _tidy(good[-1]) if good else None,
        len(good),
        len(good) < len(values),
    )


def _tidy(value: Kept) -> Kept:
    return whole(value) if isinstance(value, float) else value


def _one_of(
    choose: Callable[[float, float], float], one: float | None, other: float | None
) -> float | None:
    if one is None or other is None:
        return other if one is None else one
    return choose(one, other)
