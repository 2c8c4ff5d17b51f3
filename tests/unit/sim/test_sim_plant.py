"""The demonstration plant: it moves, and now and then a drive trips and comes back."""

from __future__ import annotations

import asyncio

import pytest
from integration.virtual_time import VirtualTimeLoop

from multidrop.catalog import load_profile
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.slink3 import State
from multidrop.sim.plant import OVERCURRENT, SHOWN, TRIP_EVERY, TRIP_FOR, DemoPlant, Shown


def test_ten_minutes_of_the_plant() -> None:
    loop = VirtualTimeLoop()
    try:
        loop.run_until_complete(watch())
    finally:
        loop.close()


async def watch() -> None:
    loop = asyncio.get_running_loop()
    plant = DemoPlant()
    running = asyncio.ensure_future(plant.run())
    speeds = set()
    tripped = cleared = 0
    was_in_fault = False
    for _ in range(int(600 / 0.5)):
        await asyncio.sleep(0.5)
        speeds.add(plant.infeed.drive.actual_speed(loop.time()))
        now_in_fault = plant.winder.drive.in_fault
        tripped += now_in_fault and not was_in_fault
        cleared += was_in_fault and not now_in_fault
        was_in_fault = now_in_fault
        assert plant.infeed.drive.state is State.OPERATION_ENABLED
        assert plant.winder.drive.malfunction_code == (OVERCURRENT if now_in_fault else 0)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert tripped == pytest.approx(600 / TRIP_EVERY, abs=1)
    assert cleared == pytest.approx(tripped, abs=1)
    assert len(speeds) > 20


def test_a_trip_lasts_long_enough_to_be_seen() -> None:
    assert 2 < TRIP_FOR < TRIP_EVERY


@pytest.mark.parametrize("shown", SHOWN, ids=lambda shown: shown.name)
def test_what_is_shown_is_there(shown: Shown) -> None:
    line = DemoPlant().lines[shown.line]
    assert shown.address in {device.address for device in line.devices}
    protocol = PROTOCOLS[load_profile(shown.profile).protocol]
    device = protocol.device(shown.address, load_profile(shown.profile), {})
    for point in shown.points:
        device.point(point)
