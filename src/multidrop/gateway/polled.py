"""What of a plant is polled: its devices as targets, the points it names, and fault words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from multidrop.io.connection import Target
from multidrop.plant import PlantDevice
from multidrop.points import Point, Role

FAULT_EVERY = 1.0
"""s between two readings of a profile's fault word where the plant does not name it."""


def target_of(device: PlantDevice) -> Target:
    """Raises `UsageError` where a key of its line is wrong."""
    return Target(device.device, device.profile)


def targets_of(devices: Iterable[PlantDevice]) -> dict[str, Target]:
    return {device.name: target_of(device) for device in devices}


def polled(device: PlantDevice) -> dict[str, float]:
    """Point name -> s. A device of which nothing is wanted is not polled at all."""
    wanted = device.every
    return {**wanted, **dict.fromkeys(fault_words(device), FAULT_EVERY)} if wanted else {}


def at_one_place(one: Point, other: Point) -> bool:
    """Whether two points are the same place in the device, read as the same type."""
    return replace(one, text="", description=None) == replace(other, text="", description=None)


def fault_words(device: PlantDevice) -> list[str]:
    """Points of the profile that say a fault, and that the plant has no name for."""
    known = device.profile.points
    named = {known[name].at for name in device.points}
    return [
        name
        for name, item in known.items()
        if item.fault is not None and name not in device.points and item.at not in named
    ]


def role_of(device: PlantDevice, name: str) -> Role:
    """What a point is for: as the plant says it, else as anything knows the place that it names.

    However the place is spelled: a control word is a command also where nobody calls it one.
    """
    point = device.points[name]
    if point.role is not None:
        return point.role
    own = target_of(device).device().point(name).role
    known = Target(device.device, device.known).device().point(device.profile.points[name].at).role
    return Role.COMMAND if Role.COMMAND in (own, known) else own
