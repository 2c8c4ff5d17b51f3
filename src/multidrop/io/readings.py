"""Many points of one device: which can be read, and each with its reading or what went wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

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

    def one_by_one(groups: Sequence[Sequence[Point]]) -> Iterator[list[Reading] | Error]:
        for group in groups:
            try:
                yield connection.read_group(group)
            except Error as error:
                yield error

    return _in_order(connection, points, one_by_one)


def in_a_row(
    connection: Connection, points: Sequence[Point]
) -> Iterator[tuple[Point, Reading | Error]]:
    """The same with no pause of the line: the next group is asked before a reading is given.

    For those whom the time of a reading does not matter to: `Connection.read_groups`.
    """
    return _in_order(connection, points, connection.read_groups)


def _in_order(
    connection: Connection,
    points: Sequence[Point],
    read: Callable[[Sequence[Sequence[Point]]], Iterator[list[Reading] | Error]],
) -> Iterator[tuple[Point, Reading | Error]]:
    group_of = {point: group for group in connection.device.plan(points) for point in group}
    groups = list({id(group_of[point]): group_of[point] for point in points}.values())
    found = read(groups)
    known: dict[Point, Reading | Error] = {}
    for point in points:
        if point not in known:
            group, readings = group_of[point], next(found)
            if isinstance(readings, Error):
                known.update(dict.fromkeys(group, readings))
            else:
                known.update(zip(group, readings, strict=True))
        yield point, known[point]
