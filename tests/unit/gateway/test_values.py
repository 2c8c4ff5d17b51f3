"""The latest of every point, and who hears of it."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest

from multidrop.gateway.clock import synchronised
from multidrop.gateway.values import CLOCK_EVERY, Update, Values
from multidrop.io.poller import Quality
from unit.gateway.updates import point, update


class Clock:
    def __init__(self) -> None:
        self.now = 100.0
        self.right: bool | None = True
        self.asked = 0

    def __call__(self) -> float:
        return self.now

    def synchronised(self) -> bool | None:
        self.asked += 1
        return self.right


def test_the_latest_is_kept_and_told() -> None:
    clock, heard = Clock(), list[Update]()
    values = Values(clock, clock.synchronised)
    values.listeners.append(heard.append)
    values.take(update(value=1).polled)
    clock.now += 1
    values.take(update(value=2, quality=Quality.STALE).polled)
    latest = values.get("infeed", "p")
    assert latest is heard[-1]
    assert [(one.value, one.good, one.monotonic) for one in heard] == [
        (1, True, 100.0),
        (2, False, 101.0),
    ]
    assert (latest.key, latest.quality) == (("infeed", "p"), Quality.STALE)
    assert values.get("infeed", "other") is None


def test_a_failed_poll_does_not_bring_back_what_is_older() -> None:
    values = Values(Clock())
    polled = update(value=1, at=1.0).polled
    found = update(value=2, at=2.0).polled
    values.take(polled)
    values.take(found)
    values.take(polled._replace(quality=Quality.NO_REPLY))
    latest = values.latest["infeed", "p"]
    assert (latest.value, latest.quality) == (2, Quality.NO_REPLY)
    values.take(polled._replace(quality=Quality.NO_REPLY, reading=None))
    assert values.latest["infeed", "p"].value == 2
    other = replace(polled.point, text="another place")
    values.take(polled._replace(point=other, quality=Quality.NO_REPLY, reading=None))
    assert values.latest["infeed", "p"].value is None


def test_whether_the_clock_is_right_is_asked_now_and_then() -> None:
    clock = Clock()
    values = Values(clock, clock.synchronised)
    values.take(update().polled)
    clock.right = False
    clock.now += CLOCK_EVERY - 1
    values.take(update().polled)
    assert (values.latest["infeed", "p"].synchronised, clock.asked) == (True, 1)
    clock.now += 1
    values.take(update().polled)
    assert (values.latest["infeed", "p"].synchronised, clock.asked) == (False, 2)


def test_the_points_of_one_device_and_those_that_are_left() -> None:
    values = Values(Clock())
    for device, name in (("a", "p"), ("a", "q"), ("b", "p")):
        values.take(update(device, name).polled)
    assert [one.point for one in values.of("a")] == ["p", "q"]
    values.keep_only({("a", "q"): point("q"), ("b", "p"): point("p"), ("c", "new"): point("new")})
    assert list(values.latest) == [("a", "q"), ("b", "p")]


def test_what_was_read_of_a_point_that_is_another_by_now_is_not_left() -> None:
    values = Values(Clock())
    for name in ("p", "q"):
        values.take(update("a", name).polled)
    values.keep_only({("a", "p"): point("p", destination=2), ("a", "q"): point("q")})
    assert list(values.latest) == [("a", "q")]


def test_who_wants_is_told_of_what_is_no_longer_polled() -> None:
    clock = Clock()
    values, told = Values(clock), list[Update]()
    values.forgetting.append(told.append)
    for name in ("p", "q"):
        values.take(update("a", name, value=5).polled)
    values.keep_only({("a", "p"): point("p"), ("a", "q"): point("q")})
    assert told == []
    clock.now += 7
    values.keep_only({("a", "q"): point("q")})
    (last,) = told
    assert (last.key, last.quality, last.value) == (("a", "p"), Quality.STALE, None)
    assert last.monotonic == clock.now


def test_what_a_listener_raises_comes_out() -> None:
    values = Values(Clock())

    def broken(heard: Update) -> None:
        raise OSError("full")

    values.listeners.append(broken)
    with pytest.raises(OSError, match="full"):
        values.take(update().polled)


def test_the_kernel_says_whether_the_clock_is_right() -> None:
    said = synchronised()
    assert said in ((True, False) if sys.platform == "linux" else (None,))
