"""Many points of one device: which can be read, and each with its reading or what went wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from multidrop.device import Device, ReadsAll
from multidrop.errors import Error, UsageError
from multidrop.io.connection import Connection
from multidrop.points import Point, Reading


def readable(device: Device) -> Sequence[Point]:
    """Every readable point of a device's profile. Raises `UsageError` where that has none."""
    if isinstance(device, ReadsAll):
        return device.readable()
    described = device.profile.points.values()
    found = [device.point(item.name) for item in described if "r" in item.access]
    if not found:
        raise UsageError(f"{device.profile.name} has no points; name them by their numbers")
    return found


def in_order(
    connection: Connection, points: Sequence[Point]
) -> Iterator[tuple[Point, Reading | Error]]:
    """Each point with its reading or what went wrong, in the order given, each group read once."""
    group_of = {point: group for group in connection.device.plan(points) for point in group}
    known: dict[Point, Reading | Error] = {}
    for point in points:
        if point not in known:
            group = group_of[point]
            try:
                known.update(zip(group, connection.read_group(group), strict=True))
            except Error as error:
                known.update(dict.fromkeys(group, error))
        yield point, known[point]
