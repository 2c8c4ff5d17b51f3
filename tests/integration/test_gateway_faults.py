"""Freeze-frames of simulated drives that trip."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Any

import pytest

from integration.plants import DriveLine, gateway, plugged_in, simulated_line, until
from multidrop.gateway.faults.freeze_frames import FreezeFrame
from multidrop.gateway.faults.part import Faults, part
from multidrop.gateway.gateway import Gateway
from multidrop.protocols.slink3.status import FAULT_RESET
from multidrop.sim.serve import serve

OVERCURRENT = 0x2310
FAULTS = "[faults]\nframes = 20\nseconds = 0.5\nkeep = 5\n"


def watched(folder: Path, *texts: str, news: list[str] | None = None) -> tuple[Gateway, Faults]:
    running = gateway(folder, *texts, FAULTS, news=news)
    faults = part(running)
    running.add(faults)
    return running, faults


def trip(line: DriveLine, address: int = 0) -> None:
    line.drives[address].drive.trip(OVERCURRENT, asyncio.get_running_loop().time())


def clear(line: DriveLine, address: int = 0) -> None:
    now = asyncio.get_running_loop().time()
    for word in (0, FAULT_RESET, 0):
        line.drives[address].drive.control(word, now)


def newest(faults: Faults, device: str = "press0") -> dict[str, Any]:
    return faults.kept.newest(device) or {}


def whole(faults: Faults, device: str = "press0") -> bool:
    """What the device said then is in it too."""
    found = newest(faults, device)
    return bool(found.get("read") or found.get("status_error"))


def test_a_trip_leaves_a_freeze_frame(tmp_path: Path) -> None:
    news: list[str] = []

    async def main() -> dict[str, Any]:
        press = DriveLine("press", 0, 1)
        async with plugged_in(press):
            running, faults = watched(tmp_path, press.toml, news=news)
            async with running:
                await until(lambda: running.device_health("press0").fault is False)
                await asyncio.sleep(0.8)
                trip(press)
                await until(lambda: whole(faults))
                assert running.device_health("press0").fault is True
                assert running.device_health("press1").fault is False
                found = newest(faults)
                clear(press)
                await until(lambda: newest(faults)["cleared"])
                await until(lambda: len(news) == 2)
                assert faults.kept.names("press1") == []
                return found

    found = asyncio.run(main())
    assert (found["device"], found["found"], found["cleared"]) == ("press0", False, None)
    assert found["name"].startswith("flexmax:0@tcp://127.0.0.1:")
    assert found["status"]["malfunction_code"] == OVERCURRENT
    assert found["status"]["state"] == "fault"
    assert any("2310h" in line for line in found["status_lines"])
    status_word, refused = found["read"]
    assert (status_word["point"], status_word["value"]) == ("status_word", 0x0208)
    assert "parameter does not exist" in refused["error"]
    ages = [value["s"] for value in found["before"]]
    assert ages == sorted(ages)
    assert ages[-1] == 0.0
    assert -0.5 <= ages[0] < -0.2
    assert {value["point"] for value in found["before"]} == {"speed", "feed"}
    assert {value["quality"] for value in found["before"]} == {"good"}
    assert len(found["frames"]) == 20
    assert "FAULT" in found["frames"][-1]["text"]
    assert [frame["sent"] for frame in found["frames"][-2:]] == [True, False]
    assert sum("FAULT" in frame["text"] for frame in found["frames"]) == 1
    times = [frame["time"] for frame in found["frames"]]
    assert times == sorted(times)
    said, gone = news
    assert said.startswith("press0: FAULT, malfunction code 2310h; freeze-frame ")
    assert gone == "press0: no fault any more"


def test_a_fault_that_was_there_before_is_kept_once(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press):
            trip(press)
            for _ in range(3):
                running, faults = watched(tmp_path, press.toml)
                async with running:
                    await until(lambda: whole(faults))  # noqa: B023
                    await until(lambda: running.device_health("press0").fault)  # noqa: B023
                assert len(faults.kept.names("press0")) == 1
                assert newest(faults)["found"] is True
            clear(press)
            running, faults = watched(tmp_path, press.toml)
            async with running:
                await until(lambda: newest(faults)["cleared"])
                trip(press)
                await until(lambda: len(faults.kept.names("press0")) == 2 and whole(faults))
                assert newest(faults)["found"] is False

    asyncio.run(main())


def test_a_word_of_another_protocol_says_it_too(tmp_path: Path) -> None:
    async def main() -> dict[str, Any]:
        line = simulated_line("ultra3000", 1)
        listener = await serve(line, "tcp://127.0.0.1:0")
        axis = (
            f'[line.axis]\nport = "{listener.port}"\n[line.axis.device.axis]\n'
            'profile = "ultra3000"\naddress = 1\non_fault = ["fault_status"]\n'
            'points = { v = "motor_velocity" }\n'
        )
        running, faults = watched(tmp_path, axis)
        async with running:
            await until(lambda: running.device_health("axis").fault is False)
            line.devices[0].servo.trip(1 << 3, 0.0)  # type: ignore[attr-defined]
            await until(lambda: whole(faults, "axis"))
        listener.close()
        return newest(faults, "axis")

    found = asyncio.run(main())
    assert found["said_by"] == "drive_status"
    (read,) = found["read"]
    assert (read["value"], read["meaning"]) == (1 << 3, "motor thermostat")
    assert found["frames"][-1]["shown"].isprintable()


def test_a_drive_that_is_silent_after_its_trip(tmp_path: Path) -> None:
    """What was before is kept nevertheless."""

    async def main() -> dict[str, Any]:
        press = DriveLine("press", 0)
        async with plugged_in(press):
            running, faults = watched(tmp_path, press.toml)
            async with running:
                await until(lambda: running.device_health("press0").fault is False)
                running.faults.listeners.append(lambda change: press.silence(0))
                trip(press)
                await until(lambda: whole(faults))
        return newest(faults)

    found = asyncio.run(main())
    assert found["status"] is None
    assert "no reply" in found["status_error"]
    assert found["read"] == []
    assert found["frames"]
    assert found["before"]


def test_a_fault_that_is_gone_before_all_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What comes behind it waits until it is whole."""

    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press):
            running, faults = watched(tmp_path, press.toml)
            save = faults.kept.save

            def slowly(frame: FreezeFrame) -> None:
                time.sleep(0.3)
                save(frame)

            monkeypatch.setattr(faults.kept, "save", slowly)
            async with running:
                await until(lambda: running.device_health("press0").fault is False)
                trip(press)
                await until(lambda: running.device_health("press0").fault)
                clear(press)
                await until(lambda: newest(faults).get("cleared"))
                assert newest(faults)["status"] is not None

    asyncio.run(main())


def test_a_disk_that_is_full_ends_nothing(tmp_path: Path) -> None:
    news: list[str] = []

    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press):
            running, faults = watched(tmp_path, press.toml, news=news)
            (tmp_path / "faults" / "press0").write_text("in the way")
            async with running:
                await until(lambda: running.device_health("press0").fault is False)
                trip(press)
                await until(lambda: news)
                clear(press)
                await until(lambda: running.device_health("press0").fault is False)
                (tmp_path / "faults" / "press0").unlink()
                trip(press)
                await until(lambda: whole(faults))

    asyncio.run(main())
    assert news[0].startswith("press0: its freeze-frame cannot be kept: ")
