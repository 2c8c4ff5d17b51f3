from __future__ import annotations

from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.batching import HEARTBEAT, Batching
from multidrop.gateway.history.records import CLOCK, RUNNING, STOPPED, Batch
from unit.gateway.history.stores import SECOND, START, sample

MINUTE = 60 * SECOND


def seconds(batch: Batch) -> list[float]:
    return [(row.time - START) / SECOND for row in batch.rows]


def test_what_came_since_the_last_time_is_a_batch() -> None:
    batching = Batching("run")
    assert batching.cut(1000.0) == []
    batching.take([sample(0, 1), sample(1, 2)])
    assert batching.samples == 2
    (batch,) = batching.cut(1001.5)
    assert (batch.number, batch.until, batch.ended) == (1, START + 1_500_000, RUNNING)
    assert (batch.span.number, batch.span.start) == (1, START)
    assert batch.span.shift == START - 1000 * SECOND
    assert seconds(batch) == [0, 1]
    assert batching.cut(1001.6) == [batch]  # until it is written
    batching.written(1)
    assert batching.samples == 0
    assert batching.cut(1001.7) == []


def test_that_nothing_came_is_told_now_and_then() -> None:
    batching = Batching("run")
    batching.take([sample(0, 1)])
    batching.written(len(batching.cut(1000.0)))
    assert batching.cut(1000.0 + HEARTBEAT - 0.1) == []
    (batch,) = batching.cut(1000.0 + HEARTBEAT)
    assert batch.rows == []
    assert batch.until == START + HEARTBEAT * SECOND
    assert batching.cut(1000.0 + 3 * HEARTBEAT) == [batch]  # one is enough while none is written


def test_a_clock_that_creeps_is_followed_by_monotonic_time() -> None:
    batching = Batching("run")
    batching.take([sample(0, 1), sample(1, 2, step=0.09), sample(2, 3, step=-0.09)])
    (batch,) = batching.cut(1002.0)
    assert seconds(batch) == [0, 1, 2]


def test_a_clock_that_steps_begins_a_span() -> None:
    batching = Batching("run")
    batching.take([sample(0, 1), sample(1, 2, step=-3600), sample(2, 3, step=-3600)])
    before, after = batching.cut(1002.0)
    assert (before.ended, after.ended) == (CLOCK, RUNNING)
    assert (before.span.number, after.span.number) == (1, 2)
    assert seconds(before) == [0]
    assert seconds(after) == [-3599, -3598]


def test_wall_time_is_believed_an_hour_after_it_stepped() -> None:
    batching = Batching("run")
    assert batching.settled is None
    batching.take([sample(0, 1), sample(3599, 2)])
    assert batching.settled is None
    batching.take([sample(3600, 3)])
    assert batching.settled == START + 60 * MINUTE
    batching.take([sample(3601, 4, step=-3600)])
    assert batching.settled is None
    batching.cut(1000.0 + 7201)
    assert batching.settled == START + 60 * MINUTE + SECOND
    batching.cut(1000.0 + 7202, stop=True)
    assert batching.settled is None


def test_the_clock_becoming_synchronised_begins_a_span() -> None:
    batching = Batching("run")
    batching.take([sample(0, 1, synchronised=None), sample(1, 2, synchronised=True)])
    assert [batch.span.synchronised for batch in batching.cut(1001.0)] == [None, True]


def test_two_samples_of_a_point_never_have_one_time() -> None:
    batching = Batching("run")
    batching.take([sample(0, 1), sample(0, 2), sample(0, 3, point="other"), sample(0, 4)])
    (batch,) = batching.cut(1000.0)
    assert [row.time - START for row in batch.rows] == [0, 1, 0, 2]


def test_the_last_batch_says_that_the_gateway_stopped() -> None:
    batching = Batching("run")
    assert batching.cut(1000.0, stop=True) == []
    batching.take([sample(0, 1)])
    batching.written(len(batching.cut(1000.0)))
    (batch,) = batching.cut(1001.0, stop=True)
    assert (batch.ended, batch.rows, batch.until) == (STOPPED, [], START + SECOND)
    assert batching.cut(1100.0) == [batch]


def test_beyond_the_bound_the_oldest_go_and_leave_a_gap() -> None:
    batching = Batching("run", most=5)
    for second in range(0, 12, 2):
        batching.take([sample(second, 0), sample(second + 1, 1)])
        waiting = batching.cut(1001.0 + second)
    assert [seconds(batch) for batch in waiting] == [[8, 9], [10, 11]]
    gap = Gap(START, START + 7 * SECOND, "nothing could be written", 8)
    assert [batch.lost for batch in waiting] == [(gap,), ()]
    assert (batching.samples, batching.lost) == (4, 8)


def test_the_newest_batch_stays_however_large_it_is() -> None:
    batching = Batching("run", most=1)
    batching.take([sample(0, 1), sample(1, 2)])
    (batch,) = batching.cut(1001.0)
    assert seconds(batch) == [0, 1]


def test_a_batch_without_samples_that_goes_is_no_gap() -> None:
    batching = Batching("run", most=3)
    batching.take([sample(0, 1)])
    batching.written(len(batching.cut(1000.0)))
    batching.cut(1000.0 + HEARTBEAT)
    batching.take([sample(20, 1), sample(21, 2)])
    batching.cut(1021.0)
    batching.take([sample(22, 1), sample(23, 2)])
    (batch,) = batching.cut(1023.0)
    gap = Gap(START + 20 * SECOND, START + 21 * SECOND, "nothing could be written", 2)
    assert batch.lost == (gap,)
