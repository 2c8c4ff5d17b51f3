"""What may be written over a network: what the plant says it may, and nothing else. Pure."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from multidrop.errors import UsageError
from multidrop.numerals import decimal_number, whole_number
from multidrop.plant import Limits, PlantDevice
from multidrop.points import Role, Value
from multidrop.profile import nearest


class NotAllowed(UsageError):
    """Nothing was sent: the plant does not allow this write."""


def allowed(device: PlantDevice, point: str, role: Callable[[], Role]) -> Limits:
    """The limits of a point that may be written; `role` works out what it is for. Raises `NotAllowed`."""
    if point not in device.points:
        raise NotAllowed(
            f"{device.name} has no point {point!r} in the plant file"
            f"{nearest(point, device.points)}; only those may be written that say write"
        )
    known = device.points[point]
    if known.write is None:
        raise NotAllowed(
            f"{device.name} {point} may not be written: the plant file has no write for it"
        )
    if not known.motion and role() is Role.COMMAND:
        raise NotAllowed(f"{device.name} {point} is a command, and has no motion = true")
    return known.write


def number(text: Value | str) -> Value | str:
    """The number that a text says, where it says one: names of values stay what they are."""
    if not isinstance(text, str):
        return text
    for read in (whole_number, decimal_number):
        try:
            return read(text)
        except ValueError:
            continue
    return text


def check_value(where: str, value: Value | str, limits: Limits) -> None:
    """Raises `NotAllowed` for anything that is not a number within the limits."""
    if isinstance(value, str | bytes) or not isfinite(value):
        raise NotAllowed(f"{value!r} is no number, so it cannot be written to {where}")
    if not limits.minimum <= value <= limits.maximum:
        raise NotAllowed(
            f"{value:g} is outside what may be written to {where}: "
            f"{limits.minimum:g}..{limits.maximum:g}"
        )


class Rates:
    """When each point was written last. A write counts from its start, done or not."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], float] = {}

    def take(self, device: str, point: str, rate: float, now: float) -> None:
        """A write begins at `now` (s). Raises `NotAllowed` where the last one is too near."""
        last = self._last.get((device, point))
        if last is not None and now - last < rate:
            raise NotAllowed(
                f"{device} {point} was written {now - last:.3g} s ago, and may be every {rate:g} s"
            )
        self._last[device, point] = now
