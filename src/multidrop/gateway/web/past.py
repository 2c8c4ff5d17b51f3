"""What was: history in buckets for charts, and as CSV; freeze-frames of devices that tripped.

The parts that keep these are there where the plant file switches them on.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import AsyncIterator, Sequence
from datetime import UTC, datetime
from typing import Any

from multidrop.errors import UsageError
from multidrop.gateway.faults.freeze_frames import FreezeFrame
from multidrop.gateway.faults.part import Faults
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.history.part import History
from multidrop.gateway.history.records import Sample
from multidrop.gateway.history.store import MOST_BUCKETS
from multidrop.gateway.web.access import Refused
from multidrop.gateway.web.shapes import utc

MOST_POINTS = 20
"""In one CSV file."""

AT_ONCE = 10_000
"""Samples that are read and sent together."""

LATEST = 32503680000.0
"""The year 3000, s."""

CSV = "text/csv; charset=utf-8"


def history_of(gateway: Gateway) -> History:
    """Raises `Refused` where none is kept."""
    history = gateway.part(History)
    if history is None:
        raise Refused(404, "no history is kept: [history] is not in the plant file")
    return history


def time_of(text: str | None, name: str) -> float:
    """Seconds since 1970, or ISO 8601 with its zone. Raises `UsageError`."""
    if text is None:
        raise UsageError(f"{name} is missing")
    try:
        if re.fullmatch(r"[0-9]{1,11}(\.[0-9]{1,9})?", text):
            seconds = float(text)
        else:
            time = datetime.fromisoformat(text)
            if time.tzinfo is None:
                raise ValueError
            seconds = time.timestamp()
    except (ValueError, OverflowError):
        raise UsageError(
            f"{name} is {text!r}: seconds since 1970, or a time such as 2026-11-22T02:31:07Z"
        ) from None
    if not 0 <= seconds <= LATEST:
        raise UsageError(f"{name} is {text!r}, which is before 1970 or after 3000")
    return seconds


def most_of(text: str | None) -> int:
    """How many buckets. Raises `UsageError`."""
    if text is None:
        return MOST_BUCKETS
    if not re.fullmatch(r"[0-9]{1,4}", text) or not 1 <= int(text) <= MOST_BUCKETS:
        raise UsageError(f"most is {text!r}, which is not 1..{MOST_BUCKETS}")
    return int(text)


def _micro(seconds: float) -> int:
    return round(seconds * 1e6)


async def columns(
    history: History, device: str, point: str, start: float, end: float, most: int
) -> dict[str, list[Any]]:
    """Buckets as columns: shorter to send, and as charts want them; none of a point without history."""
    if _micro(end) <= _micro(start):
        raise UsageError("end is not after start")
    known = (device, point) in await history.series()
    buckets = (
        await history.buckets(device, point, _micro(start), _micro(end), most) if known else []
    )
    return {
        "time": [bucket.time / 1e6 for bucket in buckets],
        "minimum": [bucket.minimum for bucket in buckets],
        "maximum": [bucket.maximum for bucket in buckets],
        "last": [bucket.last for bucket in buckets],
        "count": [bucket.count for bucket in buckets],
        "gap": [bucket.gap for bucket in buckets],
    }


async def rows(
    history: History, points: Sequence[tuple[str, str]], start: float, end: float
) -> AsyncIterator[str]:
    """CSV, a row for each sample: one point after the other, each in the order of time.

    Of a time that a clock went through twice they may come side by side.
    """
    yield _row(["device", "point", "time", "value", "quality"])
    known = await history.series()
    for device, point in points:
        if (device, point) not in known:
            continue
        async for samples in _pages(history, device, point, _micro(start), _micro(end)):
            yield "".join(
                _row([device, point, utc(at(sample.time)), sample.value, sample.quality.value])
                for sample in samples
            )


async def _pages(
    history: History, device: str, point: str, start: int, end: int
) -> AsyncIterator[list[Sample]]:
    """All samples of pieces of the time, one piece after the other, each with not too many.

    Not so many samples after each other: where the clock was put back the same times come twice,
    and who goes on behind the last one leaves out what came later at an earlier time.
    """
    width, most = end - start, AT_ONCE
    while start < end:
        until = min(end, start + width)
        samples = await history.range(device, point, start, until, most)
        if len(samples) < most:
            yield samples
            start, most = until, AT_ONCE
            if len(samples) < AT_ONCE // 4:
                width *= 2
        elif width > 1:
            width = (until - start) // 2 or 1
        else:
            most *= 2


def at(microseconds: int) -> datetime:
    return datetime.fromtimestamp(microseconds / 1e6, UTC)


def _row(cells: Sequence[Any]) -> str:
    line = io.StringIO()
    csv.writer(line).writerow(cells)
    return line.getvalue()


# -- freeze-frames -------------------------------------------------------------------------------


def faults_of(gateway: Gateway) -> Faults:
    """Raises `Refused` where none are kept."""
    faults = gateway.part(Faults)
    if faults is None:
        raise Refused(404, "no freeze-frames are kept: [faults] is not in the plant file")
    return faults


def trips(gateway: Gateway, device: str | None) -> list[dict[str, Any]]:
    """Of one device or of all, newest first, in a line each."""
    kept = faults_of(gateway).kept
    names = list(gateway.plant.devices) if device is None else [device]
    found = []
    for name in names:
        for frame_name in kept.names(name):
            try:
                frame = kept.load(name, frame_name)
            except UsageError:  # a damaged file must not hide the others
                continue
            found.append(
                {
                    "device": name,
                    "name": frame_name,
                    "time": frame["time"],
                    "cleared": frame["cleared"],
                    "status": frame["status_lines"][0] if frame["status_lines"] else None,
                    "code": (frame["status"] or {}).get("malfunction_code"),
                }
            )
    return sorted(found, key=lambda trip: str(trip["time"]), reverse=True)


def freeze_frame(gateway: Gateway, device: str, name: str) -> FreezeFrame:
    """One of them whole. Raises `Refused`."""
    kept = faults_of(gateway).kept
    try:
        return kept.load(device, name)
    except UsageError as error:
        raise Refused(404, str(error)) from None
