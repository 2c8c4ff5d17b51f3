"""The sizes that a device reckons with are those that a simulated line hears."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.device import ReadsAll
from multidrop.errors import DeviceError, UsageError
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.points import Point
from multidrop.protocols import PROTOCOLS
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import SimulatedLine


@pytest.mark.parametrize("name", ["flexmax", "ax-v", "53mc5000", "ultra3000"])
def test_every_point_of_a_profile(name: str) -> None:
    profile = load_profile(name)
    protocol = PROTOCOLS[profile.protocol]
    device = protocol.device(0, profile, {})
    wire = SimulatedLine([simulated_device(profile, 0)], protocol.line.decoder)
    line = Line(MemoryPort(wire.attach()), protocol.line.with_options(timeout=0.1, attempts=1))
    sizes = [0, 0]
    line.taps.append(lambda data, sent, now, damaged: sizes.__setitem__(sent, len(data)))
    points: list[Point] = []
    if isinstance(device, ReadsAll):
        points = list(device.readable())
    else:
        for text in profile.points:
            points += device.points(text)
    right = 0
    for point in points:
        try:
            line.run(device.read(point))
            line.run(device.read(point))
        except (DeviceError, UsageError):
            continue
        (size,) = device.sizes([point])
        stuffed = sizes[True] - size.question
        assert stuffed in (0, 1), point
        assert sizes[False] - size.answer in (stuffed, 0, 1, -2), point  # -2: no index in front
        right += 1
    assert right >= len(points) * 0.8 > 0
