"""Updates to feed the gateway's listeners with."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from multidrop.errors import NoReply, PortError
from multidrop.gateway.values import Update
from multidrop.io.poller import Polled, Quality
from multidrop.points import Point, PointDescription, Reading, Value
from multidrop.protocols.slink3.points import ParameterPoint

NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)
ERRORS = {Quality.NO_REPLY: NoReply(1), Quality.PORT_LOST: PortError("it is gone")}


def point(name: str, mask: int | None = None, destination: int = 0) -> Point:
    described = PointDescription(name, "1:int16", fault=mask)
    return ParameterPoint("1", "int16", described, index=1, destination=destination)


def reading(value: Value, fault: bool | None = None, at: float = 0.0) -> Reading:
    time = NOON + timedelta(seconds=at)
    return Reading("1", "p", value, None, "int16", b"", fault, time, 1.0)


def update(
    device: str = "infeed",
    name: str = "p",
    quality: Quality = Quality.GOOD,
    *,
    value: Value = 1,
    fault: bool | None = None,
    mask: int | None = None,
    destination: int = 0,
    at: float = 0.0,
) -> Update:
    """A good one as it was read; one of another quality with the old value."""
    polled = Polled(
        device,
        point(name, mask, destination),
        quality,
        NOON + timedelta(seconds=at),
        reading(value, fault, at),
        ERRORS.get(quality),
    )
    return Update(device, name, polled, at)
