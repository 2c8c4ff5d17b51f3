"""What was just written and read back is the newest value everywhere, without waiting for a poll."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from urllib.request import urlopen

import pytest
from pymodbus.client import AsyncModbusTcpClient

from integration.mosquitto import Broker, broker
from integration.processes import PATIENCE
from integration.published import Published, published
from integration.test_gateway_mqtt import watcher
from multidrop.errors import NotApplied
from multidrop.gateway.history.part import History
from multidrop.gateway.modbus.part import ModbusServer
from multidrop.io.poller import Quality
from multidrop.sim.slink3 import FlexMax

DEVICES = """
[line.press]
port = "{port}"
baud = 115200
timeout = 0.2
attempts = 1
[line.press.device.infeed]
profile = "flexmax"
address = 0
[line.press.device.infeed.points]
feed = {{ at = "8236:int16", every = 9000, unit = "m/min", scale = 0.1, write = {{ min = 0, max = 150 }} }}
raw_feed = {{ at = "8236:int16", every = 9000 }}
other = {{ at = "8237:int16", every = 9000 }}
speed = {{ at = "actual_speed", every = 0.1 }}
"""
"""Points that no poll reads while a test runs: what is known of them comes from writes."""

PARTS = """
[history]
path = "history.db"
[http]
listen = "127.0.0.1:0"
[modbus]
listen = "127.0.0.1:0"
[mqtt]
host = "127.0.0.1"
port = {port}
"""


async def write(site: Published, value: float) -> None:
    await site.gateway.write("infeed", "feed", value, who="ann", origin="test")


def known(site: Published, point: str = "feed") -> object:
    update = site.gateway.values.get("infeed", point)
    return None if update is None else (update.value, update.quality)


def test_it_is_there_when_the_write_returns(tmp_path: Path) -> None:
    async def main() -> None:
        async with published(tmp_path, "", DEVICES) as site:
            heard: list[tuple[str, object]] = []
            site.gateway.values.listeners.append(lambda u: heard.append((u.point, u.value)))
            await site.until(lambda: known(site, "speed") is not None)
            await write(site, 12.5)
            assert known(site) == (12.5, Quality.GOOD)
            assert known(site, "raw_feed") == (125, Quality.GOOD)  # the same place by another name
            assert known(site, "other") in (None, (0, Quality.GOOD))
            assert ("feed", 12.5) in heard
            update = site.gateway.values.get("infeed", "feed")
            assert update is not None
            reading = update.polled.reading
            assert reading is not None
            assert (reading.unit, reading.raw, reading.fault) == ("m/min", b"\x7d\x00", False)
            assert reading.time <= update.polled.time

    asyncio.run(main())


def test_what_differs_from_what_was_asked_is_told_as_it_is(tmp_path: Path) -> None:
    async def main() -> None:
        async with published(tmp_path, "", DEVICES) as site:
            drive = site.line.devices[0]
            assert isinstance(drive, FlexMax)
            drive.parameters.known[8236, 0].get = lambda now: 7
            await site.until(lambda: known(site, "speed") is not None)
            with pytest.raises(NotApplied):
                await write(site, 12.5)
            assert known(site) == (0.7, Quality.GOOD)

    asyncio.run(main())


def test_a_device_that_falls_silent_then_leaves_the_written_value_as_its_last(
    tmp_path: Path,
) -> None:
    async def main() -> None:
        devices = DEVICES.replace(
            '"8236:int16", every = 9000, unit', '"8236:int16", every = 0.1, unit'
        )
        async with published(tmp_path, "", devices) as site:
            await site.until_value("infeed", "feed", 0)
            listeners = site.gateway.values.listeners
            listeners.append(lambda u: site.line.devices.clear() if u.value == 12.5 else None)
            await write(site, 12.5)
            await site.until_said("infeed", "feed", "no reply")
            assert known(site) == (12.5, Quality.NO_REPLY)

    asyncio.run(main())


def test_every_part_has_it_at_once(tmp_path: Path) -> None:
    """Page, broker, Modbus, history: none waits for the next poll."""

    async def main(mosquitto: Broker) -> None:
        parts = PARTS.replace("{port}", str(mosquitto.port))
        async with (
            published(tmp_path, parts, DEVICES) as site,
            watcher(mosquitto, "multidrop/infeed/+") as watching,
        ):
            modbus, history = site.gateway.parts["modbus"], site.gateway.parts["history"]
            assert isinstance(modbus, ModbusServer)
            assert isinstance(history, History)
            await watching.until("multidrop/infeed/speed")
            url = next(text for text in site.said if text.startswith("http"))
            await write(site, 12.5)
            page = await asyncio.to_thread(
                lambda: urlopen(f"{url}api/values", timeout=PATIENCE).read()
            )
            values = {one["point"]: one for one in json.loads(page)}
            assert (values["feed"]["value"], values["feed"]["quality"]) == (12.5, "good")
            host, _, number = modbus.port.rpartition(":")
            one = AsyncModbusTcpClient(host, port=int(number), timeout=PATIENCE, retries=0)
            assert await one.connect()
            assert (await one.read_holding_registers(2, count=1)).registers == [125]
            one.close()
            state = await watching.until(
                "multidrop/infeed/feed", lambda state: state["quality"] == "good"
            )
            assert state["value"] == 12.5
            async with asyncio.timeout(PATIENCE):
                while ("infeed", "feed") not in await history.series():
                    await asyncio.sleep(0.05)
            sample = await history.latest("infeed", "feed")
            assert sample is not None
            assert sample.value == 12.5

    with broker(tmp_path) as mosquitto:
        asyncio.run(main(mosquitto))
