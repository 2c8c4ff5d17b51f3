"""SQLite and PostgreSQL are asked the same and say the same."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path

import pytest

from multidrop.errors import UsageError
from multidrop.gateway.gaps import Gap
from multidrop.gateway.history import sqlite as history_sqlite
from multidrop.gateway.history import store
from multidrop.gateway.history.batching import Batching
from multidrop.gateway.history.buckets import Bucketing
from multidrop.gateway.history.records import Bucket, Sample
from multidrop.gateway.history.store import KILLED, NOT_RUNNING
from multidrop.io.poller import Quality
from unit.gateway.history.stores import KINDS, SECOND, START, KeptStore, batches, kept_store, sample

END = START + 10**15


@pytest.fixture(params=KINDS)
def kept(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[KeptStore]:
    with kept_store(request.param, tmp_path) as found:
        yield found


@pytest.fixture(params=[False, True], ids=["fresh", "sealed"])
def sealed(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether samples go into blocks, of at most three, at once."""
    if request.param:
        from multidrop.gateway.history import postgres_sending as history_postgres

        for module in (store, history_sqlite, history_postgres):
            monkeypatch.setattr(module, "SEAL_ALL", 1)
            monkeypatch.setattr(module, "SEAL_ONE", 3)
    return bool(request.param)


ALL_KINDS = [
    sample(0, 1),
    sample(1, -1.5),
    sample(2, None, quality=Quality.NO_REPLY),
    sample(3, None),
    sample(4, "ready"),
    sample(5, 'ä, "quoted"\n'),
    sample(6, 2**32 - 1),
    sample(7, float("inf")),
    sample(8, 0.1),
    sample(9, "00"),
    sample(10, -(2**53)),
    sample(11, None, quality=Quality.PORT_LOST),
]


@pytest.mark.usefixtures("sealed")
def test_what_was_written_comes_back(kept: KeptStore) -> None:
    kept.write(batches(ALL_KINDS))
    assert list(kept.store.range("infeed", "speed", START, END)) == ALL_KINDS
    assert kept.store.latest("infeed", "speed") == ALL_KINDS[-1]
    assert kept.store.series() == [("infeed", "speed")]
    again = kept.again()
    assert list(again.range("infeed", "speed", START, END)) == ALL_KINDS


@pytest.mark.usefixtures("sealed")
def test_a_range_begins_with_its_start_and_ends_before_its_end(kept: KeptStore) -> None:
    kept.write(batches(ALL_KINDS))
    found = list(kept.store.range("infeed", "speed", START + 4 * SECOND, START + 9 * SECOND))
    assert found == ALL_KINDS[4:9]


@pytest.mark.usefixtures("sealed")
def test_numbers_come_back_as_what_they_were(kept: KeptStore) -> None:
    values = [1e300, -1e300, float(2**53 + 2), 2**53, 0.5, 3]
    kept.write(batches([sample(second, value) for second, value in enumerate(values)]))
    found = [one.value for one in kept.store.range("infeed", "speed", START, END)]
    assert list(map(repr, found)) == list(map(repr, values))


@pytest.mark.usefixtures("sealed")
def test_who_reads_no_further_is_in_nobodys_way(kept: KeptStore) -> None:
    kept.write(batches([sample(second, second) for second in range(500)]))
    for count in (1, 200):
        with closing(kept.store.range("infeed", "speed", START, END)) as samples:
            assert [one.value for one in islice(samples, count)] == list(range(count))
        latest = kept.store.latest("infeed", "speed")
        assert latest is not None
        assert latest.value == 499


@pytest.mark.usefixtures("sealed")
def test_a_question_that_goes_wrong_is_in_nobodys_way(
    kept: KeptStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def add(_: object, pieces: Iterator[object]) -> None:
        next(pieces)
        raise MemoryError

    kept.write(batches([sample(second, second) for second in range(500)]))
    with monkeypatch.context() as patched:
        patched.setattr(Bucketing, "add", add)
        with pytest.raises(MemoryError):
            kept.store.buckets("infeed", "speed", START, END)
    (bucket,) = kept.store.buckets("infeed", "speed", START, END, 1)
    assert bucket.count == 500


@pytest.mark.usefixtures("sealed")
def test_points_do_not_mix(kept: KeptStore) -> None:
    samples = [sample(second, second, point=point) for second in range(5) for point in "ab"]
    kept.write(batches(samples))
    assert [found.value for found in kept.store.range("infeed", "b", START, END)] == [0, 1, 2, 3, 4]
    assert {found.point for found in kept.store.range("infeed", "b", START, END)} == {"b"}


@pytest.mark.usefixtures("sealed")
def test_a_batch_that_comes_again_is_taken_once(kept: KeptStore) -> None:
    found = batches(ALL_KINDS)
    kept.write(found)
    kept.write(found)
    kept.again()
    kept.write(found)
    assert list(kept.store.range("infeed", "speed", START, END)) == ALL_KINDS


@pytest.mark.usefixtures("sealed")
def test_a_clock_that_steps_back_changes_neither_order_nor_count(kept: KeptStore) -> None:
    before = [sample(second, second) for second in range(10)]
    after = [sample(second, second, step=-7) for second in range(10, 20)]
    kept.write(batches([*before, *after]))
    found = list(kept.store.range("infeed", "speed", START, END))
    assert [one.value for one in found] == list(range(20))
    assert [one.monotonic for one in found] == [1000.0 + second for second in range(20)]
    assert found[10].time == START + 3 * SECOND
    latest = kept.store.latest("infeed", "speed")
    assert latest is not None
    assert latest.value == 19
    assert kept.store.gaps(START, END) == []


@pytest.mark.usefixtures("sealed")
def test_whether_the_clock_was_synchronised_is_kept(kept: KeptStore) -> None:
    samples = [
        sample(second, second, synchronised=known)
        for second, known in enumerate([None, None, False, True, True])
    ]
    kept.write(batches(samples))
    assert list(kept.store.range("infeed", "speed", START, END)) == samples


@pytest.mark.usefixtures("sealed")
def test_buckets(kept: KeptStore) -> None:
    values = [(second * 7) % 10 + 0.5 for second in range(20)]
    kept.write(batches([sample(second, value) for second, value in enumerate(values)]))
    found = kept.store.buckets("infeed", "speed", START, START + 20 * SECOND, 5)
    fours = [values[at : at + 4] for at in range(0, 20, 4)]
    assert found == [
        Bucket(START + 4 * place * SECOND, min(four), max(four), four[-1], 4)
        for place, four in enumerate(fours)
    ]
    whole = kept.store.buckets("infeed", "speed", START, START + 20 * SECOND, 1)
    assert whole == [Bucket(START, 0.5, 9.5, values[-1], 20)]


@pytest.mark.usefixtures("sealed")
def test_buckets_of_all_kinds_of_values(kept: KeptStore) -> None:
    kept.write(batches(ALL_KINDS))
    whole = kept.store.buckets("infeed", "speed", START, START + 12 * SECOND, 1)
    assert whole == [Bucket(START, -(2**53), float("inf"), -(2**53), 9, True)]
    each = kept.store.buckets("infeed", "speed", START, START + 12 * SECOND, 12)
    assert [bucket.last for bucket in each] == [found.value for found in ALL_KINDS]
    assert [bucket.gap for bucket in each] == [found.value is None for found in ALL_KINDS]
    assert each[4] == Bucket(START + 4 * SECOND, None, None, "ready", 1)


@pytest.mark.usefixtures("sealed")
def test_the_first_bucket_knows_what_held_before(kept: KeptStore) -> None:
    kept.write(batches([sample(0, 5), sample(1, 6), sample(9, 7)]))
    found = kept.store.buckets("infeed", "speed", START + 4 * SECOND, START + 8 * SECOND, 4)
    assert found == [Bucket(START + 4 * SECOND, 6, 6, 6, 0)]


@pytest.mark.usefixtures("sealed")
def test_a_mark_before_the_range_makes_a_gap(kept: KeptStore) -> None:
    kept.write(batches([sample(0, 5), sample(1, None, quality=Quality.PORT_LOST), sample(9, 7)]))
    found = kept.store.buckets("infeed", "speed", START + 4 * SECOND, START + 8 * SECOND, 4)
    assert found == [Bucket(START + 4 * SECOND, None, None, None, 0, True)]


@pytest.mark.parametrize(("stop", "reason"), [(True, NOT_RUNNING), (False, KILLED)])
def test_between_two_runs_there_is_a_gap(kept: KeptStore, stop: bool, reason: str) -> None:
    kept.write(batches([sample(0, 1), sample(1, 2)], stop=stop))
    kept.write(batches([sample(5, 3), sample(6, 4)], run="next"))
    gap = Gap(START + SECOND, START + 5 * SECOND, reason)
    assert kept.store.gaps(START, END) == [gap]
    assert kept.store.gaps(START + 6 * SECOND, END) == []
    found = kept.store.buckets("infeed", "speed", START, START + 8 * SECOND, 8)
    assert [(bucket.last, bucket.gap) for bucket in found] == [
        (1, False),
        (2, True),
        (3, False),
        (4, False),
    ]


def test_samples_that_were_lost_leave_a_gap(kept: KeptStore) -> None:
    batching = Batching("run", most=3)
    for second in range(6):
        batching.take([sample(second, second)])
        batching.cut(1000.0 + second)
    waiting = batching.cut(1005.0)
    kept.write(waiting)
    assert [found.value for found in kept.store.range("infeed", "speed", START, END)] == [3, 4, 5]
    gap = Gap(START, START + 2 * SECOND, "nothing could be written", 3)
    assert kept.store.gaps(START, END) == [gap]


def test_what_is_too_old_is_forgotten(kept: KeptStore, sealed: bool) -> None:
    points = [f"p{number}" for number in range(4)]
    samples = [sample(second, second, point=point) for second in range(12) for point in points]
    batching = Batching("run")
    for second in range(12):
        batching.take(samples[4 * second : 4 * second + 4])
        kept.write(batching.cut(1000.0 + second))
        batching.written(1)
    for second in range(12, 20):  # each point has its turn
        batching.take([sample(second, 0, point="other")])
        kept.write(batching.cut(1000.0 + second), START + 6 * SECOND)
        batching.written(1)
    for point in points:
        values = [found.value for found in kept.store.range("infeed", point, START, END)]
        assert values == list(range(6 if sealed else 0, 12))


def test_an_unknown_point_is_refused_with_the_nearest(kept: KeptStore) -> None:
    kept.write(batches([sample(0, 1)]))
    with pytest.raises(UsageError, match="no history of infeed sped - did you mean 'infeed speed'"):
        kept.store.latest("infeed", "sped")


@pytest.mark.parametrize(("start", "end", "most"), [(0, 1, 2001), (0, 1, 0), (1, 1, 5)])
def test_buckets_that_cannot_be(kept: KeptStore, start: int, end: int, most: int) -> None:
    with pytest.raises(UsageError):
        kept.store.buckets("infeed", "speed", start, end, most)


def test_a_long_time_of_many_samples(kept: KeptStore) -> None:
    """As much as makes blocks by itself, in batches as they come."""
    batching = Batching("run")
    written: list[Sample] = []
    for minute in range(200):
        samples = [sample(60 * minute + second, second % 7 + minute) for second in range(60)]
        batching.take(samples)
        kept.store.write(batching.cut(1000.0 + 60 * minute + 59))
        batching.written(1)
        written += samples
    if kept.kind == "postgres":
        kept.delivered()
    assert list(kept.store.range("infeed", "speed", START, END)) == written
    found = kept.store.buckets("infeed", "speed", START, START + 12000 * SECOND, 100)
    assert [(bucket.minimum, bucket.maximum, bucket.count) for bucket in found] == [
        (2 * place, 2 * place + 7, 120) for place in range(100)
    ]


def test_what_is_read_is_not_all_in_memory(kept: KeptStore) -> None:
    kept.write(batches([sample(second, second / 7) for second in range(60_000)]))
    tracemalloc.start()
    try:
        assert sum(1 for _ in kept.store.range("infeed", "speed", START, END)) == 60_000
        buckets = kept.store.buckets("infeed", "speed", START, START + 60_000 * SECOND)
        assert sum(bucket.count for bucket in buckets) == 60_000
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2_000_000  # all of them: 5 MB


@pytest.mark.parametrize("size", [1, 2000])
def test_buckets_are_the_same_however_samples_are_stored(
    kept: KeptStore, size: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    samples = [
        sample(second / 3, None if second % 97 == 0 else (second * second) % 89 / 4)
        for second in range(1000)
    ]
    (tmp_path / "other").mkdir()
    with kept_store("sqlite", tmp_path / "other") as other:
        other.write(batches(samples))
        plain = other.store.buckets("infeed", "speed", START, START + 300 * SECOND, size)
    monkeypatch.setattr(history_sqlite, "SEAL_ONE", 50)
    if kept.kind == "postgres":
        from multidrop.gateway.history import postgres_sending as history_postgres

        monkeypatch.setattr(history_postgres, "SEAL_ONE", 50)
    kept.write(batches(samples))
    assert kept.store.buckets("infeed", "speed", START, START + 300 * SECOND, size) == plain
