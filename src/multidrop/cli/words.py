"""What several commands say alike, to people and to programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from multidrop.points import Value, shown_value


def json_line(facts: Mapping[str, Any]) -> str:
    """One line of JSON Lines. `v` is the version of all of them."""
    return json.dumps({"v": 1, **facts}, ensure_ascii=False)


def utc(time: datetime) -> str:
    """A time in UTC as JSON has it: `2026-11-22T02:31:07.123456Z`."""
    return time.isoformat(timespec="microseconds").replace("+00:00", "Z")


def label(name: str | None, point: str) -> str:
    """`kp (0x011)`, or `0x011` where it has no name."""
    return f"{name} ({point})" if name else point


def with_unit(value: Value, unit: str | None) -> str:
    """`1450 rpm`."""
    return shown_value(value) + (f" {unit}" if unit else "")


def counted(number: int, what: str) -> str:
    """`1 device`, `2 devices`."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def duration(seconds: float) -> str:
    """`54 s`, `3 min 20 s`, `2 h 5 min`."""
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s" if whole >= 10 else f"{seconds:.1f} s"
    if whole < 7200:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
