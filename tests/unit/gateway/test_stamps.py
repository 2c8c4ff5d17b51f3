"""Times are written as `isoformat` writes them, in UTC with a Z."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

from hypothesis import given
from hypothesis import strategies as st

from multidrop.gateway.stamps import to_microseconds, to_milliseconds

ZONES = st.integers(-23 * 60, 23 * 60).map(lambda minutes: timezone(timedelta(minutes=minutes)))
TIMES = st.datetimes(datetime(1900, 1, 1), datetime(2200, 1, 1), timezones=st.just(UTC) | ZONES)


@given(TIMES)
def test_as_isoformat_writes_them(time: datetime) -> None:
    utc = time.astimezone(UTC)
    assert to_microseconds(time) == utc.isoformat(timespec="microseconds")[:-6] + "Z"
    assert to_milliseconds(time) == utc.isoformat(timespec="milliseconds")[:-6] + "Z"
