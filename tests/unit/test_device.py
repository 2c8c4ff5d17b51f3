"""What devices of protocols without groups share."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.conversation import Ask, Conversation
from multidrop.device import Memory, OneByOne, Sizes
from multidrop.points import Point, Sample


class Letters(OneByOne):
    """A device whose points are letters, and whose values are those letters."""

    def point(self, text: str) -> Point:
        return Point(text)

    def read(self, point: Point) -> Conversation[Any, Sample]:
        answer = yield Ask(point.text)
        return Sample(answer, "string", b"")

    def size(self, point: Point) -> Sizes:
        return Sizes(1, len(point.text))


def test_points_are_read_one_by_one() -> None:
    device = Letters()
    a, b = [*device.points("a"), *device.points("b")]
    assert device.plan([a, b]) == [(a,), (b,)]
    assert device.sizes([a, b]) == [Sizes(1, 1), Sizes(1, 1)]
    conversation = device.read_group([a, b])
    assert next(conversation) == Ask("a")
    assert conversation.send("A") == Ask("b")
    with pytest.raises(StopIteration) as stop:
        conversation.send("B")
    assert [sample.value for sample in stop.value.value] == ["A", "B"]


def sample(value: int | None) -> Sample | None:
    return None if value is None else Sample(value, "int16", b"")


@pytest.mark.parametrize(
    ("working", "saved", "default", "unsaved", "customised"),
    [
        (1, 1, 1, False, False),
        (2, 1, 1, True, False),
        (1, 2, 1, True, True),
        (1, None, 2, False, False),
        (1, 2, None, True, False),
        (None, 2, 1, False, True),
    ],
)
def test_what_a_device_keeps(
    working: int, saved: int | None, default: int | None, unsaved: bool, customised: bool
) -> None:
    memory = Memory(Point("p"), sample(working), sample(saved), sample(default))
    assert (memory.unsaved, memory.customised) == (unsaved, customised)
