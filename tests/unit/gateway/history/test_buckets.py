"""Buckets, however samples are stored, are what looking at one sample after the other gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.batching import Batching
from multidrop.gateway.history.records import CLOCK, GOOD, Batch, Bucket, Row, Span, kept
from multidrop.gateway.history.store import CARRIED
from multidrop.io.poller import Quality
from multidrop.points import Value
from unit.gateway.history.stores import SECOND, START, kept_store, sample

WHOLES = st.integers(-(2**53), 2**53) | st.integers(-3, 3)
REALS = st.floats(allow_nan=False) | st.floats(-10, 10) | st.sampled_from([0.5, 1e300])
GAPPED: st.SearchStrategy[Value] = REALS | st.just(float("nan"))
ANY: st.SearchStrategy[Value] = WHOLES | GAPPED | st.sampled_from(["", "ready", "5"])
STEPS = st.sampled_from([1, 1000, SECOND, 20 * SECOND])
TIMES = st.sampled_from([1, 1, 1, 2, 3, 5, CARRIED])
"""How many steps of a span from one sample to the next."""
CLOCKS = st.sampled_from([0.0, -7.25, 30.0, -3600.0, 86_400.0])
"""s by which wall time steps; 0: the gateway is started again."""


@st.composite
def recordings(draw: st.DrawFn) -> list[Batch]:
    """What some runs of a gateway write of one point, each in one or more spans and batches."""
    found: list[Batch] = []
    monotonic, step = 0, 0.0
    batching = Batching("run 0")
    for number in range(draw(st.integers(1, 4))):
        jump = draw(CLOCKS)
        step += jump
        if number and not jump:
            found += batching.cut(1000 + monotonic / SECOND, stop=draw(st.booleans()))
            batching = Batching(f"run {number}")
            monotonic += draw(STEPS)
        values = draw(st.sampled_from([WHOLES, WHOLES | REALS, GAPPED, ANY]))
        marks = draw(st.sampled_from([0, 0, 5]))
        width = draw(STEPS)
        several = st.lists(st.tuples(TIMES, values, st.integers(0, 9)), min_size=1, max_size=40)
        for times, value, chance in draw(several):
            monotonic += min(times * width, CARRIED)
            one = sample(monotonic / SECOND, kept(value), step=step)
            mark = one._replace(value=None if chance % 2 else one.value, quality=Quality.STALE)
            batching.take([mark if chance < marks else one])
    found += batching.cut(1000 + monotonic / SECOND)
    gap = Gap(START + draw(STEPS), START + 30 * SECOND, "the outbox was full", 3)
    return found if draw(st.booleans()) else [*found[:-1], replace(found[-1], lost=(gap,))]


@st.composite
def questions(draw: st.DrawFn, batches: Sequence[Batch]) -> tuple[int, int, int]:
    """Start, end, how many buckets: most from one sample to another, or next to them."""
    times = sorted(row.time for batch in batches for row in batch.rows)
    near = st.builds(int.__add__, st.sampled_from(times), st.sampled_from([0, 0, 1, -1, SECOND]))
    start, end = sorted((draw(st.just(times[0]) | near), draw(st.just(times[-1]) | near)))
    return start, end + draw(st.integers(1, 3)), draw(st.sampled_from([1, 2, 3, 7, 50, 2000]))


# -- one sample after the other --------------------------------------------------------------------


@dataclass
class Stretch:
    """A span with all that was written of it."""

    span: Span
    until: int = 0
    ended: str = ""
    rows: list[Row] = field(default_factory=list)


def slowly(batches: Sequence[Batch], start: int, end: int, most: int) -> list[Bucket]:
    width = max(1, -(-(end - start) // most))
    found: dict[int, list[Row]] = {}
    stretches = stretches_of(batches)
    for stretch in stretches:
        for row in stretch.rows:
            if start <= row.time < end:
                found.setdefault((row.time - start) // width, []).append(row)
    buckets = {number: bucket_of(start + number * width, rows) for number, rows in found.items()}
    held = held_before(stretches, start, end)
    if held is not None and 0 not in buckets:
        buckets[0] = replace(bucket_of(start, [held]), count=0)
    for gap in gaps_of(batches, stretches):
        if gap.start < end and gap.end >= start:
            number = (max(gap.start, start) - start) // width
            before = buckets.get(number) or Bucket(start + number * width, None, None, None, 0)
            buckets[number] = replace(before, gap=True)
    return [buckets[number] for number in sorted(buckets)]


def stretches_of(batches: Sequence[Batch]) -> list[Stretch]:
    found: dict[Span, Stretch] = {}
    for batch in batches:
        stretch = found.setdefault(batch.span, Stretch(batch.span))
        stretch.until, stretch.ended = batch.until, batch.ended
        stretch.rows += batch.rows
    return list(found.values())


def bucket_of(time: int, rows: Sequence[Row]) -> Bucket:
    good = [row.value for row in rows if row.code == GOOD and row.value is not None]
    numbers = [value for value in good if not isinstance(value, str)]
    last = good[-1] if good else None
    low, high = min(numbers, default=None), max(numbers, default=None)
    return Bucket(time, low, high, last, len(good), len(good) < len(rows))


def held_before(stretches: Sequence[Stretch], start: int, end: int) -> Row | None:
    begun = [one for one in stretches if one.span.start <= start <= one.until and start < end]
    earlier = [row for row in begun[-1].rows if row.time < start] if begun else []
    return earlier[-1] if earlier and earlier[-1].time >= start - CARRIED else None


def gaps_of(batches: Sequence[Batch], stretches: Sequence[Stretch]) -> list[Gap]:
    lost = [gap for batch in batches for gap in batch.lost]
    between = [
        Gap(one.until, max(one.until, other.span.start), "")
        for one, other in pairwise(stretches)
        if one.ended != CLOCK
    ]
    return lost + between


# -- what a store says -----------------------------------------------------------------------------


def compare(kind: str, data: st.DataObject) -> None:
    """Write a recording, a few batches at a time, and ask for buckets of it."""
    recording = data.draw(recordings())
    blocks = data.draw(st.sampled_from([1, 3, 10, 20, 4096]))
    together = data.draw(st.integers(1, len(recording)))
    with (
        TemporaryDirectory() as folder,
        pytest.MonkeyPatch.context() as patched,
        kept_store(kind, Path(folder)) as store,
    ):
        for module in ("sqlite", "postgres_sending") if kind == "postgres" else ("sqlite",):
            patched.setattr(f"multidrop.gateway.history.{module}.SEAL_ONE", blocks)
        for at in range(0, len(recording), together):
            store.write(recording[at : at + together])
        for _ in range(3):
            start, end, most = data.draw(questions(recording))
            found = store.store.buckets("infeed", "speed", start, end, most)
            assert list(map(repr, found)) == list(map(repr, slowly(recording, start, end, most)))


@given(st.data())
def test_buckets_of_sqlite_are_what_the_samples_are(data: st.DataObject) -> None:
    compare("sqlite", data)


@settings(max_examples=12)
@given(st.data())
def test_buckets_of_postgres_are_what_the_samples_are(data: st.DataObject) -> None:
    compare("postgres", data)
