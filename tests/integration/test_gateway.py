"""The gateway on real ports: what it says of its points, what it lets be written, how it is reloaded and ends."""

from __future__ import annotations

import asyncio
import errno
from pathlib import Path

import pytest

from integration.plants import DriveLine, gateway, plant, plugged_in, until
from integration.writes import logged
from multidrop.errors import DeviceError, NoReply, OutcomeUnknown, PortError, UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.history.sqlite import SqliteStore
from multidrop.gateway.permission import NotAllowed
from multidrop.io.audit import AuditLog
from multidrop.io.poller import Quality
from multidrop.writing import Outcome

HISTORY = '[history]\npath = "history.db"\n'


def qualities(running: Gateway) -> dict[str, Quality]:
    """Of the speed of each device."""
    return {
        device: update.quality
        for (device, point), update in running.values.latest.items()
        if point == "speed"
    }


def all_are(running: Gateway, *expected: Quality) -> bool:
    """In the order of the devices' names."""
    return [quality for _, quality in sorted(qualities(running).items())] == list(expected)


def test_a_device_that_falls_silent_and_one_port_that_is_lost(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0, 1, link=tmp_path / "adapter")
        vessel = DriveLine("vessel", 0)
        async with (
            plugged_in(press, vessel),
            gateway(tmp_path, press.toml, vessel.toml) as running,
        ):
            good, silent, lost = Quality.GOOD, Quality.NO_REPLY, Quality.PORT_LOST
            await until(lambda: all_are(running, good, good, good))
            press.silence(1)
            await until(lambda: qualities(running)["press1"] is silent)
            assert running.device_health("press1").silent
            update = running.values.get("press1", "speed")
            assert update is not None
            assert (update.value, update.good) == (0, False)
            press.revive(1)
            await until(lambda: all_are(running, good, good, good))
            press.unplug()
            await until(lambda: all_are(running, lost, lost, good))
            (health, _) = running.line_health()
            assert health.lost is not None
            with pytest.raises(PortError):
                await running.read("press0", "feed")
            await press.plug_in()
            await until(lambda: all_are(running, good, good, good))
            assert [line.times_opened for line in running.line_health()] == [2, 1]

    asyncio.run(main())


def test_only_what_the_plant_allows_is_written_and_all_of_it_recorded(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            await until(lambda: qualities(running))
            written = await running.write("press0", "feed", 12.5, who="ann", origin="test")
            assert written.outcome is Outcome.CONFIRMED
            assert (await running.read("press0", "feed")).value == 12.5
            for point, value in (
                ("feed", 151),
                ("feed", "fast"),
                ("feed", float("nan")),
                ("speed", 1),
                ("8236:int16", 1),
                ("control_word", 15),
            ):
                with pytest.raises(UsageError):
                    await running.write("press0", point, value, who="eve", origin="test")
            with pytest.raises(UsageError, match="no device 'pres0' - did you mean 'press0'"):
                await running.write("pres0", "feed", 1, who="eve", origin="test")
            assert (await running.read("press0", "feed")).value == 12.5
            assert (await running.read("press0", "control_word")).value == 0
            press.silence(0)
            with pytest.raises(NoReply):
                await running.write("press0", "feed", 13, who="ann", origin="test")

    asyncio.run(main())
    first, *refused, last = logged(tmp_path / "audit.jsonl")
    facts = {key: first[key] for key in ("who", "from", "name", "old", "asked", "found", "outcome")}
    assert facts == {
        "who": "ann",
        "from": "test",
        "name": "feed",
        "old": 0.0,
        "asked": 12.5,
        "found": 12.5,
        "outcome": "confirmed",
    }
    assert [(line["who"], line["outcome"]) for line in refused] == [("eve", "not-sent")] * 7
    assert all(line["error"] for line in refused)
    assert (last["who"], last["outcome"]) == ("ann", "not-sent")


def test_what_is_no_number_and_what_comes_too_soon(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        limits = "write = { min = 0, max = 150"
        text = press.toml.replace(limits, f"{limits}, rate = 60")
        text += 'ratio = { at = "8300:float32", write = { min = 0, max = 1 } }\n'
        async with plugged_in(press):
            text = text.replace("tcp://127.0.0.1:0", press.port)
            async with gateway(tmp_path, text) as running:
                await until(lambda: qualities(running))
                for value in (float("nan"), "nan", float("inf"), "-inf"):
                    with pytest.raises(UsageError):
                        await running.write("press0", "ratio", value, who="eve", origin="test")
                await running.write("press0", "feed", "12.5", who="ann", origin="test")
                with pytest.raises(NotAllowed, match="and may be every 60 s"):
                    await running.write("press0", "feed", 13, who="ann", origin="test")
                assert (await running.read("press0", "feed")).value == 12.5

    asyncio.run(main())
    outcomes = [line["outcome"] for line in logged(tmp_path / "audit.jsonl")]
    assert outcomes == ["not-sent"] * 4 + ["confirmed", "not-sent"]


def test_what_the_device_refuses_is_recorded_once(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        press.drives[0].parameters.known[8236, 0].maximum = 500
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            await until(lambda: qualities(running))
            with pytest.raises(DeviceError):
                await running.write("press0", "feed", 60, who="ann", origin="test")

    asyncio.run(main())
    (line,) = logged(tmp_path / "audit.jsonl")
    assert (line["who"], line["asked"], line["outcome"]) == ("ann", 60, "not-applied")


def test_who_asked_may_go_away_and_the_write_is_ended(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            await until(lambda: qualities(running))
            asking = asyncio.ensure_future(
                running.write("press0", "feed", 12.5, who="ann", origin="test")
            )
            await asyncio.sleep(0)
            asking.cancel()
            await asyncio.gather(asking, return_exceptions=True)
        with pytest.raises(NotAllowed, match="the gateway is stopping"):
            await running.write("press0", "feed", 1, who="ann", origin="test")

    asyncio.run(main())
    assert [line["outcome"] for line in logged(tmp_path / "audit.jsonl")] == [
        "confirmed",
        "not-sent",
    ]


def test_a_write_without_its_record_is_not_made(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        (tmp_path / "audit.jsonl").mkdir()
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            await until(lambda: qualities(running))
            with pytest.raises(UsageError, match="audit log"):
                await running.write("press0", "feed", 12.5, who="ann", origin="test")
            assert (await running.read("press0", "feed")).value == 0

    asyncio.run(main())


def test_a_write_that_could_not_be_recorded_any_more_is_not_called_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk became full between the look and the line."""

    def full(log: AuditLog, device: str, record: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(AuditLog, "written", full)

    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            await until(lambda: qualities(running))
            with pytest.raises(OutcomeUnknown, match=r"could not be recorded: .* No space left"):
                await running.write("press0", "feed", 12.5, who="ann", origin="test")

    asyncio.run(main())


def test_a_reload_leaves_alone_what_did_not_change(tmp_path: Path) -> None:
    async def main() -> None:
        lines = [DriveLine(name, 0) for name in ("kept", "changed", "gone", "new")]
        kept, changed, gone, new = lines
        texts = [line.toml for line in (kept, changed, gone)]
        async with plugged_in(*lines):
            texts = [line.toml for line in (kept, changed, gone)]
            async with gateway(tmp_path, *texts) as running:
                await until(lambda: len(qualities(running)) == 3)
                before = dict(running.lines)
                other = changed.toml.replace("feed =", "rate =")
                done = await running.reload(plant(tmp_path, kept.toml, other, new.toml))
                assert done.started == ("new",)
                assert (done.changed, done.stopped, done.kept) == (
                    ("changed",),
                    ("gone",),
                    ("kept",),
                )
                assert running.lines["kept"] is before["kept"]
                await until(lambda: running.values.get("changed0", "rate"))
                await until(lambda: running.values.get("new0", "speed"))
                assert running.values.get("changed0", "feed") is None
                assert running.values.get("gone0", "speed") is None
                opened = {line.name: line.times_opened for line in running.line_health()}
                assert opened == {"kept": 1, "changed": 1, "new": 1}
                with pytest.raises(UsageError):
                    await running.read("gone0", "speed")
                assert before["gone"].service.lost is not None

    asyncio.run(main())


def test_history_marks_what_a_reload_takes_out(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        made = gateway(tmp_path, press.toml, HISTORY)
        made.add_parts()
        async with plugged_in(press), made as running:
            await until(lambda: running.values.get("press0", "feed"))
            await running.reload(plant(tmp_path, press.toml.replace("feed =", "rate ="), HISTORY))
        store = SqliteStore(tmp_path / "history.db", only_read=True)
        last = store.latest("press0", "feed")
        store.close()
        assert last is not None
        assert (last.value, last.quality) == (None, Quality.STALE)

    asyncio.run(main())


def test_a_line_with_other_settings_is_opened_anew(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            await until(lambda: qualities(running))
            before = running.lines["press"]
            slower = press.toml.replace("timeout = 0.2", "timeout = 0.3")
            done = await running.reload(plant(tmp_path, slower))
            assert (done.started, done.changed, done.stopped) == (("press",), (), ())
            assert running.lines["press"] is not before
            running.values.keep_only({})
            await until(lambda: all_are(running, Quality.GOOD))

    asyncio.run(main())


def test_a_plant_that_is_wrong_changes_nothing(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        async with plugged_in(press), gateway(tmp_path, press.toml) as running:
            before = running.plant
            with pytest.raises(UsageError, match="does not fit int16"):
                await running.reload(plant(tmp_path, press.toml.replace("max = 150", "max = 9999")))
            assert running.plant is before
            await until(lambda: all_are(running, Quality.GOOD))

    asyncio.run(main())


class Part:
    """A part that may fail; it says when it was started and ended."""

    def __init__(self, name: str, said: list[str], fails: Exception | None = None) -> None:
        self.name = name
        self._said = said
        self._fails = fails

    async def run(self) -> None:
        self._said.append(f"{self.name} starts")
        try:
            if self._fails is not None:
                raise self._fails
            await asyncio.sleep(3600)
        finally:
            self._said.append(f"{self.name} ends")


def test_parts_live_as_long_as_the_gateway(tmp_path: Path) -> None:
    said: list[str] = []

    async def main() -> None:
        press = DriveLine("press", 0)
        parts = (Part("history", said), Part("http", said))
        async with plugged_in(press), gateway(tmp_path, press.toml, parts=parts) as running:
            await until(lambda: qualities(running))
            said.append("stopping")

    asyncio.run(main())
    assert said == ["history starts", "http starts", "stopping", "http ends", "history ends"]


def test_a_part_that_fails_ends_the_gateway(tmp_path: Path) -> None:
    async def main() -> None:
        press = DriveLine("press", 0)
        parts = (Part("history", []), Part("http", [], PortError("the port is taken")))
        async with plugged_in(press), gateway(tmp_path, press.toml, parts=parts) as running:
            async with asyncio.timeout(5):
                await running.run()

    with pytest.raises(PortError, match="the port is taken") as failed:
        asyncio.run(main())
    assert failed.value.__notes__ == ["in part http of the gateway"]


def test_a_plant_that_is_wrong_is_not_begun(tmp_path: Path) -> None:
    async def main() -> None:
        gateway(tmp_path, '[line.a]\nport = "x"\n')

    with pytest.raises(UsageError, match=r"line\.a has no devices"):
        asyncio.run(main())
