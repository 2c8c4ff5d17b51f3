"""What is looked at before it becomes a sample is recorded as if it had been one at once."""

from __future__ import annotations

from collections.abc import Iterable
from typing import cast

from hypothesis import given
from hypothesis import strategies as st

from multidrop.gateway.history.part import History, sample_of
from multidrop.gateway.history.records import Sample
from multidrop.gateway.history.reporting import Reporting, Rule
from multidrop.gateway.history.store import Store
from multidrop.gateway.values import Update
from multidrop.io.poller import Quality
from multidrop.points import Value
from unit.gateway.updates import update

VALUES = st.sampled_from([0, 1, 1.0, 1.4, 2, float("nan"), True, "text", b"\x01"])
STEPS = st.lists(st.tuples(VALUES, st.sampled_from(list(Quality)), st.floats(0.0, 20.0)))


class Recorded(History):
    """A history that shows what it would write."""

    def __init__(self, rule: Rule) -> None:
        super().__init__(cast("Store", None), lambda device, point: rule)
        self.samples: list[Sample] = []

    def append(self, samples: Iterable[Sample]) -> None:
        self.samples += samples


def updates(steps: list[tuple[Value, Quality, float]]) -> list[Update]:
    found, at = [], 0.0
    for value, quality, step in steps:
        at += step
        found.append(update(value=value, quality=quality, at=at))
    return found


@given(STEPS, st.sampled_from([0.0, 0.5]))
def test_the_same_is_recorded(steps: list[tuple[Value, Quality, float]], deadband: float) -> None:
    rule = Rule(deadband, longest=30.0)
    reporting, history = Reporting(rule), Recorded(rule)
    expected: list[Sample] = []
    for one in updates(steps):
        expected += reporting.take(sample_of(one))
        history.take(one)
    assert history.samples == expected
