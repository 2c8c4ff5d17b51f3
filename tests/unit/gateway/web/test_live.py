"""Live values: nothing new is lost, a slow listener gets the newest, a text is made once for all."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime

import pytest

from multidrop.errors import NoReply
from multidrop.gateway.values import Update, Values
from multidrop.gateway.web import shapes
from multidrop.gateway.web.live import Live
from multidrop.gateway.web.shapes import value_text
from multidrop.io.poller import Polled, Quality
from multidrop.points import Point, Value
from unit.gateway.updates import NOON, update


class Plant:
    """Values that somebody else fills, and how often each was written."""

    def __init__(self) -> None:
        self.values = Values(lambda: 0.0)
        self.written = 0
        self.live = Live(self.values, self._write)

    def _write(self, update: Update) -> str:
        self.written += 1
        at = f"{update.device}/{update.point}"
        return json.dumps({"at": at, "second": update.polled.time.second})

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
    assert plant.written == 1


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
    plant.values.keep_only({("a", "y"): plant.values.latest["a", "y"].polled.point})
    assert plant.since(0)[1] == [("a/y", 2)]


@within_loop
async def test_values_from_before_are_there(plant: Plant) -> None:
    plant.say("a", "x", 1)
    late = Live(plant.values, lambda update: json.dumps({"point": update.point}))
    assert json.loads(late.since(0)[1]) == [{"point": "x"}]


@within_loop
async def test_closing_lets_go(plant: Plant) -> None:
    waiting = asyncio.create_task(plant.live.wait(60.0))
    await asyncio.sleep(0)
    plant.live.close()
    await asyncio.wait_for(waiting, 1.0)
    assert plant.live.closed


@pytest.mark.parametrize(
    "value",
    [0, -5, 12.5, 1e300, float("nan"), float("-inf"), True, False, 'a "text" \x00 é', b"\x01"],
)
@pytest.mark.parametrize("quality", list(Quality))
def test_the_quick_way_to_write_a_value_writes_the_same(value: Value, quality: Quality) -> None:
    told = update('in"feed', "pé", quality, value=value, fault=True)
    assert value_text(told) == json.dumps(shapes.value(told), allow_nan=False)


def test_a_value_that_was_never_read_is_written_the_same() -> None:
    polled = Polled("a", Point("x"), Quality.NO_REPLY, NOON, None, NoReply(1))
    told = Update("a", "x", polled, 0.0)
    assert value_text(told) == json.dumps(shapes.value(told))
