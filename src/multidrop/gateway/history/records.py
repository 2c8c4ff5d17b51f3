"""What history is made of: samples, the spans of time they were taken in, batches, gaps, buckets.

Pure. Times are whole microseconds since 1970 UTC.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import NamedTuple

from multidrop.gateway.gaps import Gap
from multidrop.io.poller import Quality
from multidrop.points import Value

Kept = int | float | str | None
"""A value as history keeps it; None where there is none."""

QUALITIES = (
    Quality.GOOD,
    Quality.STALE,
    Quality.REFUSED,
    Quality.WRONG,
    Quality.NO_REPLY,
    Quality.PORT_LOST,
)
"""A quality's place in here is what is stored of it: nothing may ever be moved or taken out."""

CODES = {quality: code for code, quality in enumerate(QUALITIES)}
GOOD = 0

EXACT = 2**53
"""Up to here a float holds every whole number."""


class Sample(NamedTuple):
    """A value of a point, or the mark that from here on there was none.

    `monotonic` (s) goes on where wall time steps; `synchronised` says whether wall time
    could be trusted, None where nobody knew.
    """

    device: str
    point: str
    time: int
    monotonic: float
    synchronised: bool | None
    value: Kept
    quality: Quality = Quality.GOOD


class Row(NamedTuple):
    """A sample as a batch holds it; its span knows the rest."""

    device: str
    point: str
    time: int
    value: Kept
    code: int


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of a run of the gateway in which wall time did not step.

    `shift` is wall time - monotonic time. Spans, and the samples in each, are in the order in
    which they happened, whatever wall time says.
    """

    run: str
    number: int
    start: int
    shift: int
    synchronised: bool | None


RUNNING, STOPPED, CLOCK = "", "stopped", "clock"
"""How a span ended: it did not or was killed, with the gateway, or as wall time stepped."""


@dataclass(frozen=True, slots=True)
class Batch:
    """What is written at once: rows of one span, up to which time it is whole, and what was lost.

    (`span.run`, `number`) names it: a store takes it once, however often it comes.
    """

    number: int
    span: Span
    until: int
    ended: str = RUNNING
    rows: list[Row] = field(default_factory=list)
    lost: tuple[Gap, ...] = ()


@dataclass(frozen=True, slots=True)
class Bucket:
    """What was in one of the equal parts of a time range, from `time` on.

    `gap`: from somewhere in here until the next bucket with a value the point was, for a
    while or throughout, not known. `count` 0 without a gap: the value of before the range.
    Texts have a last value only.
    """

    time: int
    minimum: int | float | None
    maximum: int | float | None
    last: Kept
    count: int
    gap: bool = False


def kept(value: Value | None) -> Kept:
    """A value as both stores can hold it: bytes in hex, truth values as 0 and 1, no NaN."""
    if isinstance(value, float):
        if value.is_integer() and abs(value) <= EXACT:
            return int(value)
        return value if value == value else None
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, int):
        return value if abs(value) <= EXACT else str(value)
    if isinstance(value, bytes):
        return value.hex()
    return value if value is None else _clean(value)


def _clean(text: str) -> str:
    """Without what no database holds: NUL and halves of surrogate pairs."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}").encode(errors="replace").decode()


def whole(value: float | None) -> int | float | None:
    """A number as `kept` leaves it, from what knows floats only."""
    if value is None or isinstance(value, int):
        return value
    if isfinite(value):
        return int(value) if value.is_integer() and abs(value) <= EXACT else value
    return value if value == value else None


__all__ = [
    "CLOCK",
    "CODES",
    "GOOD",
    "QUALITIES",
    "RUNNING",
    "STOPPED",
    "Batch",
    "Bucket",
    "Gap",
    "Kept",
    "Row",
    "Sample",
    "Span",
    "kept",
    "whole",
]
