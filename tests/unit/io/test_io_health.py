"""Silent devices: who is probed when, and how much of the line that may take."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.io.health import JUST_SILENT, PROBES, Health, Load, Probe, total
from multidrop.session import Counters

WORST = 1.5


def test_a_device_that_answers_is_left_alone() -> None:
    health = Health()
    assert not health.heard("a")
    assert health.silent == []
    assert health.deadline == float("inf")
    assert health.take(0.0, WORST) is None


def test_silence_and_the_first_answer() -> None:
    health = Health()
    assert health.not_heard("a", 5.0)
    assert not health.not_heard("a", 6.0)
    assert health.silent_since("a") == 5.0
    assert health.silent == ["a"]
    assert health.heard("a")
    assert health.silent_since("a") is None
    assert health.deadline == float("inf")


def test_a_device_that_was_there_until_now_is_probed_at_once() -> None:
    health = Health()
    health.not_heard("a", 5.0)
    assert health.take(5.0, WORST) == Probe("a", True)


def test_a_probe_is_paid_for_by_its_own_time() -> None:
    health = Health()
    health.not_heard("a", 0.0)
    probe = health.take(0.0, WORST)
    assert probe is not None
    assert health.take(0.0, WORST) == Probe("a", False)
    assert health.deadline == WORST / (PROBES - JUST_SILENT)  # until it is known: the worst
    health.probed(Probe("a", False), 0.4)
    assert health.deadline == pytest.approx(0.4 / (PROBES - JUST_SILENT))
    assert health.take(9.9, WORST) is None
    assert health.take(10.1, WORST) == Probe("a", False)


def test_a_probe_that_was_answered_costs_nothing() -> None:
    """A line whose devices were all switched on again has them back at once."""
    health = Health()
    for name in "abc":
        health.not_heard(name, 0.0)
    for name in "abc":
        probe = health.take(1.0, WORST)
        assert probe is not None
        assert probe.name == name
        health.heard(name)
        health.probed(probe, 0.03)
    assert health.silent == []


def test_who_is_probed_takes_turns() -> None:
    health = Health()
    for name in "abc":
        health.not_heard(name, 0.0)
    order = []
    now = 0.0
    for _ in range(12):
        probe = health.take(now, WORST)
        assert probe is not None
        order.append(probe.name)
        health.probed(probe, WORST)
        now = health.deadline
    assert sorted(order[:3]) == ["a", "b", "c"]
    assert all(order[at] != order[at + 1] for at in range(11))
    assert {order.count(name) for name in "abc"} <= {3, 4, 5}


def test_one_that_falls_silent_does_not_wait_for_the_dead() -> None:
    health = Health()
    health.not_heard("dead", 0.0)
    for _ in range(2):
        probe = health.take(0.0, WORST)
        assert probe is not None
        health.probed(probe, WORST)
    assert health.take(20.0, WORST) is None
    health.not_heard("noisy", 160.0)
    probe = health.take(160.0, WORST)
    assert probe == Probe("noisy", True)


@given(
    st.integers(1, 40),
    st.lists(st.floats(0.01, WORST), min_size=1, max_size=200),
    st.floats(0.0, 0.5),
)
def test_probes_take_at_most_their_share(dead: int, times: list[float], delay: float) -> None:
    """However many are silent, and however long each probe takes; in every stretch of time."""
    health = Health()
    for name in range(dead):
        health.not_heard(str(name), 0.0)
    now = 0.0
    spells: list[tuple[float, float]] = []
    for seconds in times:
        now = max(now, health.deadline) + delay
        probe = health.take(now, WORST)
        assert probe is not None
        spells.append((now, seconds))
        now += seconds
        health.probed(probe, seconds)
    for first in range(len(spells)):
        used = 0.0
        for begin, seconds in spells[first:]:
            used += seconds
            assert used <= PROBES * (begin + seconds - spells[first][0]) + 2 * WORST


@given(
    st.lists(
        st.tuples(st.sampled_from("abcde"), st.sampled_from(["heard", "silent", "probe"])),
        max_size=60,
    )
)
def test_whatever_happens_the_silent_are_those_that_can_be_probed(
    events: list[tuple[str, str]],
) -> None:
    health = Health()
    silent: set[str] = set()
    for now, (name, event) in enumerate(events):
        if event == "heard":
            assert health.heard(name) == (name in silent)
            silent.discard(name)
        elif event == "silent":
            assert health.not_heard(name, now) == (name not in silent)
            silent.add(name)
        else:
            probe = health.take(now, WORST)
            if probe is not None:
                assert probe.name in silent
                health.probed(probe, 0.0)
        assert set(health.silent) == silent
        assert (health.deadline == float("inf")) == (not silent)
    waiting = [*health._just_silent, *health._ring]
    assert sorted(waiting) == sorted(silent)


# -- load and counters ---------------------------------------------------------------------------


def test_the_load_of_the_last_minute() -> None:
    load = Load(60.0)
    assert load.share(100.0) == 0.0
    for second in range(100, 110):
        load.add(second, second + 0.5)
    assert load.share(110.0) == pytest.approx(0.5)
    assert load.share(130.0) == pytest.approx(5.0 / 30)
    assert load.share(165.0) == pytest.approx(2.5 / 60, abs=0.01)
    assert load.share(300.0) == 0.0


def test_a_load_is_never_more_than_all() -> None:
    load = Load(10.0)
    load.add(0.0, 30.0)
    assert load.share(30.0) == 1.0
    assert Load().share(0.0) == 0.0


def test_counters_of_several_times_open() -> None:
    first, second = Counters(requests=2, foreign=1), Counters(requests=3, damaged=4)
    assert total([first, second]) == Counters(requests=5, foreign=1, damaged=4)
