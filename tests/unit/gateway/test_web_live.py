"""Live values: nothing new is lost, a slow listener gets the newest, a text is made once for all."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from typing import Any

from multidrop.gateway.values import Update, Values
from multidrop.gateway.web.live import Live
from multidrop.io.poller import Polled, Quality
from multidrop.points import Point


class Plant:
    """Values that somebody else fills, and how often each was shaped."""

    def __init__(self) -> None:
        self.values = Values(lambda: 0.0)
        self.shaped = 0
        self.live = Live(self.values, self._shape)

    def _shape(self, update: Update) -> dict[str, Any]:
        self.shaped += 1
        return {"at": f"{update.device}/{update.point}", "second": update.polled.time.second}

    def say(self, device: str, point: str, second: int) -> None:
        time = datetime(2026, 11, 22, 2, 31, second, tzinfo=UTC)
        self.values.take(Polled(device, Point(point), Quality.GOOD, time))

    def since(self, number: int, *devices: str) -> tuple[int, list[tuple[str, int]]]:
        upto, text = self.live.since(number, frozenset(devices) or None)
        found = json.loads(text) if text else []
        return upto, [(item["at"], item["second"]) for item in found]


def within_loop(test: Callable[[Plant], Awaitable[None]]) -> Callable[[], None]:
    def run() -> None:
        async def work() -> None:
            await test(Plant())

        asyncio.run(work())

    return run


@within_loop
async def test_who_comes_late_gets_everything_once(plant: Plant) -> None:
    plant.say("a", "x", 1)
    plant.say("b", "x", 2)
    plant.say("a", "x", 3)
    number, found = plant.since(0)
    assert found == [("b/x", 2), ("a/x", 3)]
    assert plant.since(number) == (number, [])


@within_loop
async def test_only_what_is_new_and_only_of_some_devices(plant: Plant) -> None:
    plant.say("a", "x", 1)
    number, _ = plant.since(0)
    plant.say("b", "x", 2)
    plant.say("a", "y", 3)
    assert plant.since(number)[1] == [("b/x", 2), ("a/y", 3)]
    assert plant.since(number, "b")[1] == [("b/x", 2)]


@within_loop
async def test_a_text_is_made_once_for_all_who_listen(plant: Plant) -> None:
    plant.say("a", "x", 1)
    first = plant.since(0)
    assert [plant.since(0) for _ in range(5)] == [first] * 5
    assert plant.shaped == 1


@within_loop
async def test_what_comes_between_two_who_ask_is_not_lost(plant: Plant) -> None:
    """The second one is given the text of the first, and only up to where that goes."""
    plant.live.listeners = 2
    plant.say("a", "x", 1)
    number, _ = plant.since(0)
    plant.say("a", "y", 2)
    again, found = plant.since(0)
    assert (again, found) == (number, [("a/x", 1)])
    await plant.live.wait(1.0)
    assert plant.since(again)[1] == [("a/y", 2)]


@within_loop
async def test_a_point_that_is_no_longer_polled_is_not_told(plant: Plant) -> None:
    plant.say("a", "x", 1)
    plant.say("a", "y", 2)
    plant.values.keep_only([("a", "y")])
    assert plant.since(0)[1] == [("a/y", 2)]


@within_loop
async def test_values_from_before_are_there(plant: Plant) -> None:
    plant.say("a", "x", 1)
    late = Live(plant.values, lambda update: {"point": update.point})
    assert json.loads(late.since(0)[1]) == [{"point": "x"}]


@within_loop
async def test_closing_lets_go(plant: Plant) -> None:
    waiting = asyncio.create_task(plant.live.wait(60.0))
    await asyncio.sleep(0)
    plant.live.close()
    await asyncio.wait_for(waiting, 1.0)
    assert plant.live.closed
