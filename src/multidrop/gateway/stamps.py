"""Times as records and as JSON have them. Pure.

Thousands are written each second, so a second is written once.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from functools import lru_cache

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_DAY = 86_400  # s
_MICROSECOND = timedelta(microseconds=1)


@lru_cache(maxsize=16)
def _second(seconds: int) -> str:
    """`2026-11-22T02:31:07`, of seconds since 1970."""
    return (_EPOCH + timedelta(seconds=seconds)).isoformat().removesuffix("+00:00")


def to_milliseconds(time: datetime) -> str:
    """Of an aware time: `2026-11-22T02:31:07.123Z`, UTC. What is finer is cut off."""
    since = time - _EPOCH
    return f"{_second(since.days * _DAY + since.seconds)}.{since.microseconds // 1000:03d}Z"


def to_microseconds(time: datetime) -> str:
    """Of an aware time: `2026-11-22T02:31:07.123456Z`, UTC."""
    since = time - _EPOCH
    return f"{_second(since.days * _DAY + since.seconds)}.{since.microseconds:06d}Z"


def microseconds(time: datetime) -> int:
    """Of an aware `datetime`, since 1970."""
    return (time - _EPOCH) // _MICROSECOND


def moment(time: int) -> datetime:
    """The same back, UTC."""
    return _EPOCH + timedelta(microseconds=time)
