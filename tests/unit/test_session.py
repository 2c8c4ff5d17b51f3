"""What a line remembers: its counters, and what was counted since a copy of them."""

from __future__ import annotations

from dataclasses import fields

from multidrop.session import Counters

NAMES = [item.name for item in fields(Counters)]


def test_counting_what_was_counted_since() -> None:
    line = Counters(*(10 * at for at in range(len(NAMES))))
    before = line.copy()
    assert before == line
    for at, name in enumerate(NAMES):
        setattr(line, name, getattr(line, name) + at + 1)
    assert before != line, "a copy does not go on counting"
    device = Counters(*(100 for _ in NAMES))
    device.count_since(before, line)
    assert device == Counters(*(101 + at for at in range(len(NAMES))))
