"""How long a value is on its way: from the end of its answer on the wire to who is told of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any

from bench.counting import WRAP
from bench.measure import percentile

Told = tuple[str, str, Any, float]
"""Device, point, value, when (monotonic, s)."""


def latencies(
    told: Iterable[Told], handed_over: Sequence[Sequence[float]], begin: float, end: float
) -> list[float]:
    """ms for each answer in this time (monotonic, s): a value says which of its line's answers it is.

    Devices are named `l2d0`: the first one of line 2. Points whose names do not begin
    with `count` do not count.
    """
    found = []
    for device, point, value, at in told:
        if not point.startswith("count") or value is None:
            continue
        times = handed_over[int(device[1:].partition("d")[0])]
        number = int(value)
        while number + WRAP < len(times) and times[number + WRAP] <= at:
            number += WRAP
        if number < len(times) and begin <= times[number] < end:
            found.append((at - times[number]) * 1000)
    return found


def shown(values: Sequence[float]) -> str:
    """Median and 99th percentile, ms."""
    return f"{median(values):.1f} / {percentile(values, 0.99):.1f} ms"
