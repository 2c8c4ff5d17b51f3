"""What two passports do not agree on. Measured points are never compared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from multidrop.errors import UsageError
from multidrop.passports.passport import Entry, Passport, Unread
from multidrop.points import Role, Value

MOVING = frozenset({Role.SETPOINT, Role.COMMAND})
"""Roles that are compared on request only: they change while a machine works."""


@dataclass(frozen=True, slots=True)
class Difference:
    """A point that differs; on a side that does not have it None, or why it could not be read."""

    point: str
    name: str | None
    before: Entry | Unread | None
    after: Entry | Unread | None


def differences(
    before: Passport, after: Passport, *, everything: bool = False
) -> Iterator[Difference]:
    """In the order of `before`, then what only `after` has.

    Setpoints and commands with `everything` only. Raises `UsageError` for
    passports of different models.
    """
    if before.profile != after.profile:
        raise UsageError(
            f"{before.device} is of profile {before.profile}, {after.device} of {after.profile}:"
            " their points cannot be compared"
        )
    held, holds = _points(before), _points(after)
    for point in held | holds:
        one, other = held.get(point), holds.get(point)
        known = one or other
        assert known is not None
        if known.role is Role.MEASURED or (known.role in MOVING and not everything):
            continue
        if not same(one, other):
            yield Difference(point, known.name, one, other)


def same(one: Entry | Unread | None, other: Entry | Unread | None) -> bool:
    """Whether both sides hold the same value; two that cannot be read say nothing.

    What counts is the value, as somebody may have edited it; equal raw bytes
    only say that it has the same unit.
    """
    if isinstance(one, Entry) and isinstance(other, Entry):
        alike = (one.type, one.raw) == (other.type, other.raw)
        return _equal(one.value, other.value) and (alike or one.unit == other.unit)
    return isinstance(one, Unread) and isinstance(other, Unread)


def _equal(one: Value, other: Value) -> bool:
    return one == other or (one != one and other != other)  # NaN is not equal to itself


def _points(passport: Passport) -> dict[str, Entry | Unread]:
    return {**passport.points, **passport.unreadable}
