from __future__ import annotations

import pytest

from multidrop.gateway.history.records import Kept
from multidrop.gateway.history.reporting import Reporting, Rule
from multidrop.io.poller import Quality
from unit.gateway.history.stores import sample

LOST = Quality.PORT_LOST


def reported(values: list[Kept | Quality], **rule: float) -> list[int]:
    """The seconds of which samples are recorded, one a second; a quality stands for a mark."""
    reporting = Reporting(Rule(**{"longest": 1000.0, **rule}))
    found = []
    for second, value in enumerate(values):
        mark = isinstance(value, Quality)
        quality = value if isinstance(value, Quality) else Quality.GOOD
        one = sample(second, None if mark else value, quality=quality)
        found += [round(item.monotonic - 1000) for item in reporting.take(one)]
    return found


@pytest.mark.parametrize(
    ("values", "seconds"),
    [
        ([5], [0]),
        ([5, 5, 5], [0]),
        ([1, 2, 3], [0, 1, 2]),
        ([1, 1, 1, 2, 2], [0, 2, 3]),  # 2 is the last second of the old value
        ([1, 2, 2, 1], [0, 1, 2, 3]),
        (["a", "a", "b"], [0, 1, 2]),
        (["a", 1], [0, 1]),
        ([None, None, 1], [0, 1, 2]),
        ([1, 1, LOST, LOST, 1, 1], [0, 1, 2, 3, 4]),
        ([1, LOST, Quality.NO_REPLY, 1], [0, 1, 2, 3]),
    ],
)
def test_changes_are_recorded_with_the_sample_before(
    values: list[Kept | Quality], seconds: list[int]
) -> None:
    assert reported(values) == seconds


@pytest.mark.parametrize(
    ("values", "seconds"),
    [
        ([10, 10.4, 9.6, 10], [0]),
        ([10, 10.5], [0, 1]),
        ([10, 9.5], [0, 1]),
        ([10, 10.3, 10.6], [0, 1, 2]),  # it creeps: compared with what was recorded
        ([float("inf"), float("inf"), 1], [0, 1, 2]),
        (["a", "b"], [0, 1]),
    ],
)
def test_a_change_smaller_than_the_dead_band_is_none(
    values: list[Kept | Quality], seconds: list[int]
) -> None:
    assert reported(values, deadband=0.5) == seconds


def test_what_does_not_change_is_recorded_now_and_then() -> None:
    assert reported([7] * 10, longest=4.0) == [0, 4, 8]
    assert reported([LOST] * 10, longest=4.0) == [0, 4, 8]


def test_the_longest_interval_begins_with_what_was_recorded_last() -> None:
    assert reported([1, 1, 1, 2, 2, 2, 2, 2], longest=4.0) == [0, 2, 3, 7]
