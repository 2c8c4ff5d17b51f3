"""Poll plans: what is joined, how full a line is, what is due when."""

from __future__ import annotations

from bisect import bisect_left

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.catalog import load_profile
from multidrop.device import Device
from multidrop.errors import UsageError
from multidrop.io.polling import TYPICAL_DELAY, Plan, Schedule, Wanted, line_time
from multidrop.protocols import PROTOCOLS, datalink, slink3

CHARACTER = 11 / 9600
READ = 24 * CHARACTER + TYPICAL_DELAY + 0.002  # s of an int16 over SLINK3


def device(profile: str, address: int = 0) -> Device:
    found = load_profile(profile)
    return PROTOCOLS[found.protocol].device(address, found, {})


def wanted(name: str, texts: list[str], every: float, profile: str = "slink3") -> Wanted:
    found = device(profile)
    return Wanted(name, found, tuple(p for text in texts for p in found.points(text)), every)


def drives(count: int, every: float) -> list[Wanted]:
    return [wanted(f"drive{number}", ["8236:int16"], every) for number in range(count)]


def test_the_load_of_a_line() -> None:
    plan = Plan(slink3.LINE, drives(10, 1.0))
    assert plan.load == pytest.approx(10 * READ)
    assert str(plan) == "39 %"


def test_what_more_points_would_make_of_it() -> None:
    plan = Plan(slink3.LINE, drives(10, 1.0))
    more = [wanted("other", ["1:int16", "2:int16", "3:int16"], 0.5)]
    assert plan.with_more(more) == "39 %; with these 3 points 63 %"
    assert plan.with_more(drives(1, 0.5)) == "39 %; with this point 43 %"
    assert plan.adding(more).load == pytest.approx(10 * READ + 6 * READ)
    assert plan.load == pytest.approx(10 * READ)


def test_measured_delays_are_reckoned_with() -> None:
    plan = Plan(slink3.LINE, drives(2, 1.0)).learned({"drive1": 0.1})
    assert plan.load == pytest.approx(2 * READ - TYPICAL_DELAY + 0.1)
    assert plan.adding(drives(2, 0.5)[1:]).load == pytest.approx(3 * READ + 2 * 0.09)


def test_neighbouring_points_are_one_message() -> None:
    plan = Plan(datalink.LINE, [wanted("loop", ["C100..C103"], 1.0, "53mc5000")])
    (poll,) = plan.polls
    assert len(poll.group) == 4
    assert poll.seconds == pytest.approx((6 + 6 + 12) * CHARACTER + TYPICAL_DELAY)


def test_points_of_different_periods_are_not_joined() -> None:
    fast = wanted("loop", ["C100"], 0.5, "53mc5000")
    slow = wanted("loop", ["C101"], 5.0, "53mc5000")
    assert [len(poll.group) for poll in Plan(datalink.LINE, [fast, slow]).polls] == [1, 1]


def test_a_point_that_is_wanted_twice_is_read_with_the_shorter_period() -> None:
    plan = Plan(slink3.LINE, [*drives(1, 5.0), *drives(1, 0.5), *drives(1, 1.0)])
    assert [poll.every for poll in plan.polls] == [0.5]


@pytest.mark.parametrize("every", [0.0, 0.0009, 90000, float("nan"), float("inf")])
def test_periods_that_nobody_can_keep(every: float) -> None:
    with pytest.raises(UsageError, match=r"drive0: every .* out of range: 0\.001\.\.86400 s"):
        drives(1, every)


def test_the_time_of_several_messages() -> None:
    sizes = device("53mc5000").sizes([device("53mc5000").point("mem/0/40")])
    seconds = line_time(slink3.LINE, sizes, 0.1)
    assert seconds == pytest.approx((6 + 38 + 6 + 14) * CHARACTER + 2 * 0.102)


# -- phases --------------------------------------------------------------------------------------


def test_phases_of_one_period_are_even() -> None:
    plan = Plan(slink3.LINE, drives(10, 1.0))
    assert [poll.phase for poll in plan.polls] == pytest.approx([n / 10 for n in range(10)])


def test_a_device_is_not_asked_twice_in_a_row() -> None:
    asked = [wanted(name, ["1:int16", "2:int16", "3:int16"], 1.0) for name in "abc"]
    names = [poll.name for poll in Plan(slink3.LINE, asked).polls]
    assert names == list("abcabcabc")


@given(st.integers(1, 40), st.floats(0.05, 60.0), st.floats(0.0, 5.0))
def test_polls_do_not_bunch(count: int, every: float, span: float) -> None:
    """In any time, no more polls of a period begin than its even share, and one."""
    plan = Plan(slink3.LINE, drives(count, every))
    times = sorted(poll.phase + n * every for poll in plan.polls for n in range(4))
    for begin in times[:count]:
        inside = bisect_left(times, begin + span * every / 5) - bisect_left(times, begin)
        assert inside <= span / 5 * count + 1.001


# -- what is due ---------------------------------------------------------------------------------


def test_nothing_to_poll_is_never_due() -> None:
    schedule = Schedule(Plan(slink3.LINE, []), 0.0)
    assert schedule.deadline == float("inf")
    assert schedule.take(1e9) is None


PLANS = st.lists(
    st.tuples(st.integers(0, 3), st.sampled_from([0.1, 0.25, 1.0, 7.0])), min_size=1, max_size=12
).map(
    lambda pairs: Plan(
        slink3.LINE,
        [
            wanted(f"drive{name}", [f"{number}:int16"], every)
            for number, (name, every) in enumerate(pairs)
        ],
    )
)


@given(
    PLANS,
    st.floats(0.0, 1e6),
    st.lists(st.tuples(st.floats(0.0, 3.0), st.floats(0.0, 3.0)), max_size=60),
)
def test_no_drift_no_bursts_and_none_is_forgotten(
    plan: Plan, start: float, waits: list[tuple[float, float]]
) -> None:
    schedule = Schedule(plan, start)
    now = start
    number = dict.fromkeys(plan.polls, 0)
    for wait, seconds in waits:
        now += wait
        due = schedule.take(now)
        if due is None:
            assert schedule.deadline > now
            continue
        poll = due.poll
        assert due.at <= now
        assert due.number == number[poll]  # each period once
        assert due.at == start + poll.phase + due.number * poll.every  # on its grid
        now += seconds
        missed = schedule.finish(due, now)
        assert missed >= 0
        number[poll] += 1 + missed
        begun = (now - start - poll.phase) / poll.every
        assert number[poll] <= max(begun, due.number + 1) + 1e-6
        assert number[poll] > begun - 1 - 1e-6  # only the newest period may still be read


@given(PLANS, st.integers(1, 300))
def test_what_is_taken_in_time_keeps_its_period(plan: Plan, count: int) -> None:
    schedule = Schedule(plan, 5.0)
    number = dict.fromkeys(plan.polls, 0)
    for _ in range(count):
        now = schedule.deadline
        due = schedule.take(now)
        assert due is not None
        assert schedule.finish(due, now + 0.01) == 0
        assert due.at == now == 5.0 + due.poll.phase + number[due.poll] * due.poll.every
        number[due.poll] += 1


@given(PLANS)
def test_on_a_line_that_is_too_full_every_poll_has_its_turn(plan: Plan) -> None:
    """While one is due, each of the others is taken at most once."""
    schedule = Schedule(plan, 0.0)
    now = 100.0
    order = []
    for _ in range(10 * len(plan.polls)):
        due = schedule.take(now)
        assert due is not None
        order.append(due.poll)
        now += 10.0  # longer than any period: all are due all the time
        schedule.finish(due, now)
    for at in range(0, len(order), len(plan.polls)):
        assert set(order[at : at + len(plan.polls)]) == set(plan.polls)


@given(PLANS)
def test_what_is_under_way_is_not_due(plan: Plan) -> None:
    schedule = Schedule(plan, 0.0)
    taken = []
    while (due := schedule.take(1000.0)) is not None:
        taken.append(due)
    assert {due.poll for due in taken} == set(plan.polls)
    assert schedule.deadline == float("inf")
    schedule.finish(taken[0], 1000.0)
    again = schedule.take(1000.0)
    assert again is not None
    assert again.poll == taken[0].poll
