"""What a reload must never do: write by rules of one plant file to places of another, or give out old values as new."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from integration.plants import DriveLine, gateway, plant, plugged_in, until
from multidrop.errors import PortError, UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.line import GatewayLine
from multidrop.io.poller import Quality
from multidrop.plantfile import PlantDevice
from multidrop.sim.slink3 import FlexMax


def value_at(drive: FlexMax, index: int) -> object:
    return drive.parameters.known[index, 0].value


def good(running: Gateway, *keys: tuple[str, str]) -> bool:
    found = [running.values.get(*key) for key in keys]
    return all(update is not None and update.good for update in found)


def test_nothing_is_written_between_two_plant_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line has the new places of the points already, the limits are still the old ones."""
    changed, go_on = asyncio.Event(), asyncio.Event()
    real = GatewayLine.change

    async def slow(line: GatewayLine, devices: list[PlantDevice]) -> None:
        await real(line, devices)
        changed.set()
        await go_on.wait()

    monkeypatch.setattr(GatewayLine, "change", slow)

    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            await until(lambda: good(running, ("press0", "feed")))
            other = press.toml.replace("8236:int16", "8250:int16").replace("max = 150", "max = 10")
            reloading = asyncio.create_task(running.reload(plant(tmp_path, other)))
            await changed.wait()
            with pytest.raises(PortError, match="while the plant file is being read again"):
                await running.write("press0", "feed", 120, who="ann", origin="test")
            go_on.set()
            await reloading
            assert value_at(press.drives[0], 8236) == 0
            with pytest.raises(UsageError, match=r"0\.\.10 m/min"):
                await running.write("press0", "feed", 120, who="ann", origin="test")

    asyncio.run(main())


def test_what_a_point_was_is_not_what_it_is(tmp_path: Path) -> None:
    """A point that is elsewhere, or is scaled otherwise, has no value until it was read there."""

    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            await until(lambda: good(running, ("press0", "feed"), ("press0", "speed")))
            await running.write("press0", "feed", 12.5, who="ann", origin="test")
            speed = running.values.get("press0", "speed")
            press.silence(0)
            await until(lambda: running.values.latest["press0", "feed"].quality is Quality.NO_REPLY)
            assert running.values.latest["press0", "feed"].value == 12.5
            await running.reload(plant(tmp_path, press.toml.replace("scale = 0.1", "scale = 10")))
            found = running.values.get("press0", "feed")
            assert found is None or found.value is None
            assert running.values.get("press0", "speed") is not None
            assert speed is not None
            press.revive(0)
            await running.line_of("press0").service.try_now("press0")
            await until(lambda: good(running, ("press0", "feed")))
            assert running.values.latest["press0", "feed"].value == 1250

    asyncio.run(main())
