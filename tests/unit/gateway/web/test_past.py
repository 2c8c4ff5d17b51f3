"""CSV of what was: every sample, once, however many there are and whatever the clock did."""

from __future__ import annotations

import asyncio
import csv
from io import StringIO
from typing import cast

import pytest

from multidrop.gateway.history.part import History
from multidrop.gateway.history.records import Sample
from multidrop.gateway.web import past
from multidrop.io.poller import Quality

POINT = ("infeed", "speed")


class Kept:
    """Samples in the order in which they were taken, as a history gives them."""

    def __init__(self, times: list[int]) -> None:
        self.samples = [
            Sample(*POINT, time, float(number), True, number, Quality.GOOD)
            for number, time in enumerate(times)
        ]
        self.asked = 0

    async def series(self) -> list[tuple[str, str]]:
        return [POINT]

    async def range(self, device: str, point: str, start: int, end: int, most: int) -> list[Sample]:
        self.asked += 1
        return [one for one in self.samples if start <= one.time < end][:most]


def values(kept: Kept, start: float = 0.0, end: float = past.LATEST) -> list[int]:
    async def text() -> str:
        rows = past.rows(cast("History", kept), [POINT], start, end)
        return "".join([piece async for piece in rows])

    return [int(row["value"]) for row in csv.DictReader(StringIO(asyncio.run(text())))]


@pytest.fixture(autouse=True)
def few_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(past, "AT_ONCE", 10)


@pytest.mark.parametrize("count", [0, 1, 9, 10, 11, 100])
def test_every_sample_comes_once_and_in_order(count: int) -> None:
    times = [1_764_000_000_000_000 + number * 500_000 for number in range(count)]
    assert values(Kept(times)) == list(range(count))


def test_a_clock_that_was_put_back_hides_and_doubles_nothing() -> None:
    before = [1_764_000_000_000_000 + number * 500_000 for number in range(50)]
    again = [time - 15_000_000 for time in before]
    found = values(Kept(before + again))
    assert sorted(found) == list(range(100))


def test_many_samples_of_one_microsecond_come_all() -> None:
    assert sorted(values(Kept([5] * 25))) == list(range(25))


def test_a_time_with_nothing_in_it_is_asked_for_in_few_questions() -> None:
    kept = Kept([])
    assert values(kept) == []
    assert kept.asked < 50


def test_the_end_is_not_included() -> None:
    assert values(Kept([1_000_000, 2_000_000, 3_000_000]), 1.0, 3.0) == [0, 1]
