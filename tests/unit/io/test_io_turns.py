"""Turns on one wire: priorities, fairness among devices, those who give up."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.io.turns import PASSED_OVER, Priority, Turns, Waiting
from unit.io.lines import in_virtual_time

WRITE, OPERATOR, POLL, BACKGROUND = Priority
ENTRIES = st.lists(st.tuples(st.sampled_from(Priority), st.integers(0, 4) | st.none()), max_size=60)


def all_of(waiting: Waiting[Any]) -> list[Any]:
    found = []
    while (waiter := waiting.pop()) is not None:
        found.append(waiter)
    assert len(waiting) == 0
    return found


def test_priorities() -> None:
    waiting: Waiting[str] = Waiting()
    for priority in (BACKGROUND, POLL, OPERATOR, WRITE):
        waiting.add(priority.name, priority, 0)
    assert all_of(waiting) == ["WRITE", "OPERATOR", "POLL", "BACKGROUND"]


def test_devices_take_turns() -> None:
    waiting: Waiting[str] = Waiting()
    for text in ("a1", "a2", "a3", "b1", "b2", "c1"):
        waiting.add(text, POLL, text[0])
    assert all_of(waiting) == ["a1", "b1", "c1", "a2", "b2", "a3"]


@given(ENTRIES)
def test_each_has_one_turn_and_those_of_a_device_keep_their_order(
    entries: list[tuple[Priority, int | None]],
) -> None:
    waiting: Waiting[int] = Waiting()
    for number, (priority, device) in enumerate(entries):
        waiting.add(number, priority, device)
    assert len(waiting) == len(entries)
    popped = all_of(waiting)
    assert sorted(popped) == list(range(len(entries)))
    for same in set(entries):
        numbers = [number for number in popped if entries[number] == same]
        assert numbers == sorted(numbers)


@given(ENTRIES, st.lists(st.booleans(), min_size=60, max_size=60))
def test_who_gave_up_leaves_no_trace(
    entries: list[tuple[Priority, int | None]], stays: list[bool]
) -> None:
    """What is left comes in the order of a queue that never saw the others, per device."""
    waiting: Waiting[int] = Waiting()
    for number, (priority, device) in enumerate(entries):
        waiting.add(number, priority, device)
    for number, (priority, device) in enumerate(entries):
        if not stays[number]:
            waiting.remove(number, priority, device)
    left = [number for number in range(len(entries)) if stays[number]]
    assert len(waiting) == len(left)
    assert sorted(all_of(waiting)) == left
    assert waiting._queues == ({}, {}, {}, {})


def test_who_does_not_wait_cannot_give_up() -> None:
    waiting: Waiting[int] = Waiting()
    with pytest.raises(ValueError, match="not in"):
        waiting.remove(1, POLL, 0)
    assert len(waiting) == 0


@given(st.lists(st.integers(0, 5) | st.none(), max_size=80))
def test_while_one_waits_each_other_device_is_served_once(steps: list[int | None]) -> None:
    """A device comes, or (None) a turn is over: nobody overtakes the same one twice."""
    waiting: Waiting[int] = Waiting()
    served: list[int] = []
    since: dict[int, int] = {}  # device -> how many were served when its first began to wait
    for device in steps:
        if device is not None:
            since.setdefault(device, len(served))
            waiting.add(device, POLL, device)
            continue
        popped = waiting.pop()
        if popped is None:
            assert not since
            continue
        before = served[since.pop(popped) :]
        assert len(set(before)) == len(before)
        assert popped not in before
        served.append(popped)
        if popped in waiting._queues[POLL]:
            since[popped] = len(served)


@given(st.integers(1, 5))
def test_polls_do_not_starve_the_background(devices: int) -> None:
    waiting: Waiting[str] = Waiting()
    waiting.add("scan", BACKGROUND, None)
    waiting.add("scan", BACKGROUND, None)
    seen = []
    for number in range(3 * PASSED_OVER):
        waiting.add("poll", POLL, number % devices)
        seen.append(waiting.pop())
    assert [at for at, who in enumerate(seen) if who == "scan"] == [
        PASSED_OVER,
        2 * PASSED_OVER + 1,
    ]


def test_the_background_never_goes_before_a_person() -> None:
    waiting: Waiting[str] = Waiting()
    waiting.add("scan", BACKGROUND, None)
    for _ in range(PASSED_OVER):
        waiting.add("poll", POLL, 0)
        assert waiting.pop() == "poll"
    waiting.add("poll", POLL, 0)
    waiting.add("read", OPERATOR, 0)
    waiting.add("write", WRITE, 0)
    assert all_of(waiting) == ["write", "read", "scan", "poll"]


# -- in a loop ---------------------------------------------------------------------------------


async def one_turn(turns: Turns, name: str, done: list[str], priority: Priority = POLL) -> None:
    if not turns.take():
        await turns.wait(priority, name)
    try:
        done.append(name)
        await asyncio.sleep(1)
    finally:
        turns.release()


def tasks_of(*coroutines: Coroutine[Any, Any, None]) -> list[asyncio.Task[None]]:
    return [asyncio.ensure_future(coroutine) for coroutine in coroutines]


def test_tasks_take_turns() -> None:
    async def main() -> None:
        turns, done = Turns(), list[str]()
        await asyncio.gather(
            one_turn(turns, "first", done),
            one_turn(turns, "scan", done, BACKGROUND),
            one_turn(turns, "poll", done),
            one_turn(turns, "write", done, WRITE),
        )
        assert done == ["first", "write", "poll", "scan"]
        assert not turns.taken

    in_virtual_time(main)


def test_a_task_that_is_cancelled_while_it_waits() -> None:
    async def main() -> None:
        turns, done = Turns(), list[str]()
        tasks = tasks_of(*(one_turn(turns, name, done) for name in "abc"))
        await asyncio.sleep(0.5)
        tasks[1].cancel()
        await asyncio.wait(tasks[1:2])
        assert len(turns) == 1
        await tasks[2]
        assert done == ["a", "c"]
        assert not turns.taken

    in_virtual_time(main)


def test_a_task_that_is_cancelled_as_its_turn_comes() -> None:
    """It was given the turn and has not run yet: the turn goes on to the next."""

    async def main() -> None:
        turns, done = Turns(), list[str]()
        assert turns.take()
        tasks = tasks_of(*(one_turn(turns, name, done) for name in "ab"))
        await asyncio.sleep(0)
        turns.release()
        tasks[0].cancel()
        await tasks[1]
        assert tasks[0].cancelled()
        assert done == ["b"]
        assert not turns.taken

    in_virtual_time(main)


def test_a_turn_that_is_over_as_its_next_owner_is_cancelled() -> None:
    """It was cancelled and has not run yet: the turn goes past it."""

    async def main() -> None:
        turns, done = Turns(), list[str]()
        assert turns.take()
        tasks = tasks_of(*(one_turn(turns, name, done) for name in "ab"))
        await asyncio.sleep(0)
        tasks[0].cancel()
        turns.release()
        await tasks[1]
        assert tasks[0].cancelled()
        assert done == ["b"]
        assert not turns.taken

    in_virtual_time(main)


def test_a_poll_that_follows_at_once_goes_before_the_background() -> None:
    """Also one that did not wait yet when the turn was over; then the background has its turn."""

    async def main() -> None:
        turns, done = Turns(), list[str]()
        assert turns.take()
        scan = asyncio.ensure_future(one_turn(turns, "scan", done, BACKGROUND))
        await asyncio.sleep(0)
        for number in range(PASSED_OVER):
            turns.release()
            assert not turns.take()
            await turns.wait(POLL, number)
            assert done == []
        turns.release()
        await turns.wait(POLL, None)
        assert done == ["scan"]
        turns.release()
        await scan
        assert not turns.taken

    in_virtual_time(main)


def test_the_background_has_a_turn_that_nobody_else_takes() -> None:
    async def main() -> None:
        turns, done = Turns(), list[str]()
        assert turns.take()
        scan = asyncio.ensure_future(one_turn(turns, "scan", done, BACKGROUND))
        await asyncio.sleep(0)
        turns.release()
        await asyncio.sleep(0.001)
        assert done == ["scan"]
        await scan

    in_virtual_time(main)


TASKS = st.lists(
    st.tuples(
        st.integers(0, 20),  # when it comes
        st.integers(0, 4),  # how long it holds the turn
        st.none() | st.integers(0, 30),  # when it is cancelled
        st.sampled_from(Priority),
        st.integers(0, 3),
    ),
    max_size=25,
)


@given(TASKS)
def test_whoever_is_cancelled_whenever(
    plans: list[tuple[int, int, int | None, Priority, int]],
) -> None:
    """One owner at a time, nobody who stays is forgotten, and in the end the turn is free."""

    async def main() -> None:
        turns, owners, done = Turns(), list[int](), set[int]()

        async def one(number: int, at: int, hold: int, priority: Priority, device: int) -> None:
            await asyncio.sleep(at)
            if not turns.take():
                await turns.wait(priority, device)
            try:
                owners.append(number)
                assert owners == [number]
                await asyncio.sleep(hold)
                done.add(number)
            finally:
                owners.remove(number)
                turns.release()

        loop = asyncio.get_running_loop()
        tasks = []
        for number, (at, hold, cancel, priority, device) in enumerate(plans):
            task = asyncio.ensure_future(one(number, at, hold, priority, device))
            tasks.append(task)
            if cancel is not None:
                loop.call_later(cancel, task.cancel)
        results = await asyncio.gather(*tasks, return_exceptions=True)
        for number, result in enumerate(results):
            assert (number in done) == (result is None)
            assert result is None or isinstance(result, asyncio.CancelledError)
            assert result is None or plans[number][2] is not None
        assert not turns.taken
        assert len(turns) == 0

    in_virtual_time(main)
