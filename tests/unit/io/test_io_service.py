"""A line service: polls, silence, probes, lost ports, counters; in virtual time."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from integration.virtual_time import VirtualTimeLoop

from multidrop.errors import (
    DeviceError,
    NoReply,
    OutcomeUnknown,
    PortError,
    ProtocolError,
    UsageError,
)
from multidrop.io.polling import Plan
from multidrop.io.service import LineService, Polled, Quality
from multidrop.io.turns import Priority
from multidrop.protocols import slink3
from multidrop.sim.faults import Fault
from multidrop.sim.slink3 import FlexMax
from unit.io.lines import in_virtual_time
from unit.io.services import TIME_OUT, TRANSACTION, Log, World, in_world

GOOD, NO_REPLY, PORT_LOST = Quality.GOOD, Quality.NO_REPLY, Quality.PORT_LOST
REFUSED, STALE = Quality.REFUSED, Quality.STALE
POINT = "8236:int16"


@contextlib.asynccontextmanager
async def polling(service: LineService, plan: Plan) -> AsyncIterator[Log]:
    log = Log()
    task = asyncio.create_task(service.poll(plan, log))
    try:
        yield log
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def every(service: LineService, period: float) -> Plan:
    return service.plan([(name, [POINT], period) for name in service.devices])


# -- polling -------------------------------------------------------------------------------------


def test_polls_keep_their_period(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 0.5)) as log:
            await asyncio.sleep(10.0)
            for name in service.devices:
                times = log.times(name)
                assert 19 <= len(times) <= 20
                steps = [after - before for before, after in itertools.pairwise(times)]
                assert steps == pytest.approx([0.5] * len(steps), abs=1e-6)
            assert service.load == pytest.approx(3 * (TRANSACTION - 0.002) / 0.5, rel=0.06)
            assert service.missed == 0
            first = log.all[0][1]
            assert (first.good, first.value, first.error) == (True, 0, None)
            assert first.reading is not None
            assert abs((first.time - first.reading.time).total_seconds()) < 1.0

    in_world(monkeypatch, 3, test)


def test_a_line_that_is_too_full_serves_all_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            plan = every(service, 0.05)
            assert plan.load > 1.9
            async with polling(service, plan) as log:
                await asyncio.sleep(10.0)
                counts = log.count()
                assert sum(counts.values()) == pytest.approx(10.0 / TRANSACTION, abs=4)
                assert max(counts.values()) - min(counts.values()) <= 2
                assert service.missed == pytest.approx(600 - 10.0 / TRANSACTION, abs=10)
                assert service.load > 0.99

    in_world(monkeypatch, 3, test)


def test_the_delay_is_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            plan = every(service, 0.5)
            assert service.delays == {}
            async with polling(service, plan):
                await asyncio.sleep(5.0)
            assert service.delays == pytest.approx({"d0": 0.005, "d1": 0.005}, abs=1e-4)
            assert every(service, 0.5).load == pytest.approx(2 * TRANSACTION / 0.5)
            assert plan.learned(service.delays).load < plan.load

    in_world(monkeypatch, 2, test)


def test_no_device_answers_before_it_was_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line that is faster than its baud rate says so, as behind a network."""

    async def test(world: World) -> None:
        async with world.service() as service:
            service.device("d0").notice_delay(-0.003)
            assert service.delays == {"d0": 0.0}

    in_world(monkeypatch, 1, test)


def test_a_refused_point(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            plan = service.plan([("d0", [POINT, "9999:int16", "8236:float32"], 0.5)])
            async with polling(service, plan) as log:
                await asyncio.sleep(1.0)
            found = {one.point.text: one for _, one in log.all}
            assert found["8236"].quality in (GOOD, REFUSED)
            assert found["9999"].quality is REFUSED
            assert isinstance(found["9999"].error, DeviceError)
            assert found["9999"].reading is None
            assert found["9999"].value is None
            assert service.devices["d0"].counters.refusals >= 2
            assert service.health.silent == []

    in_world(monkeypatch, 1, test)


def test_an_answer_that_breaks_the_rules(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            device = service.device("d0")
            right = slink3.Master.read_typed

            def wrong(*arguments: object, **keys: object) -> object:
                yield from right(*arguments, **keys)  # type: ignore[arg-type]
                raise ProtocolError("another type came")

            monkeypatch.setattr(type(device.device.master), "read_typed", wrong)  # type: ignore[attr-defined]
            async with polling(service, every(service, 0.5)) as log:
                await asyncio.sleep(1.0)
            assert set(log.qualities("d0")) == {Quality.WRONG}
            assert service.health.silent == []

    in_world(monkeypatch, 1, test)


def test_what_nobody_could_read_for_long_is_stale(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 0.5)) as log:
            await asyncio.sleep(2.2)
            assert service.devices["d0"].line.turns.take()  # somebody holds the line
            await asyncio.sleep(10.0)
            service.devices["d0"].line.turns.release()
            await asyncio.sleep(1.0)
            qualities = log.qualities("d0")
            assert qualities.count(STALE) == 1
            assert qualities[-1] is GOOD
            (stale,) = [one for _, one in log.all if one.quality is STALE]
            assert stale.value == 0
            assert not stale.good
            assert qualities.count(GOOD) <= 9  # at most the one under way and the newest period

    in_world(monkeypatch, 1, test)


def test_a_program_that_stood_still_calls_nothing_stale(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine under load, a debugger, a call that blocks: what was due is read before it is judged."""

    async def test(world: World) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        async with world.service() as service, polling(service, every(service, 0.5)) as log:
            await asyncio.sleep(2.2)
            loop.stand_still(10.0)
            back = loop.time()
            await asyncio.sleep(2.0)
            assert log.qualities("d0").count(GOOD) == len(log.qualities("d0"))
            assert min(at for at in log.times("d0") if at >= back) < back + 0.5
            world.unplug()
            loop.stand_still(10.0)
            await asyncio.sleep(2.0)
            assert STALE not in log.qualities("d0")
            assert log.qualities("d0")[-1] is PORT_LOST

    in_world(monkeypatch, 1, test)


def test_readings_as_an_iterator(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            names = []
            async with contextlib.aclosing(service.readings(every(service, 0.1))) as found:
                async for polled in found:
                    names.append(polled.device)
                    if len(names) == 6:
                        break
            assert sorted(names) == ["d0", "d0", "d1", "d1", "d2", "d2"]
            assert service._pollings == []

    in_world(monkeypatch, 3, test)


class Wrong(Exception):
    """Of the one who listens."""


@pytest.mark.parametrize("off", [(), (0,)])
def test_what_the_listener_raises_comes_out(
    monkeypatch: pytest.MonkeyPatch, off: tuple[int, ...]
) -> None:
    async def test(world: World) -> None:
        def listen(polled: Polled) -> None:
            raise Wrong

        world.switch_off(*off)
        async with world.service() as service:
            with pytest.raises(Wrong):
                await service.poll(every(service, 0.1), listen)

    in_world(monkeypatch, 1, test)


def test_a_plan_of_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service, polling(service, service.plan([])) as log:
            await asyncio.sleep(3.0)
            assert log.all == []

    in_world(monkeypatch, 1, test)


def test_who_is_slower_than_the_line_gets_the_newest(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        service = world.service()
        async with service, contextlib.aclosing(service.readings(every(service, 0.1))) as found:
            await anext(found)
            await asyncio.sleep(5.0)
            names = [(await anext(found)).device for _ in range(3)]
            assert sorted(names) == ["d0", "d1", "d2"]  # one of each, however many came

    in_world(monkeypatch, 3, test)


def test_closing_ends_the_polling(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        service = world.service()
        async with service:
            task = asyncio.create_task(service.poll(every(service, 0.1), Log()))
            readings = service.readings(every(service, 0.1))
            await anext(readings)
        await task
        async for _ in readings:  # what is left; then it ends
            pass

    in_world(monkeypatch, 1, test)


def test_a_bug_of_the_service_does_not_pass_for_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        def broken(now: float, worst: float) -> None:
            raise ZeroDivisionError

        async with world.service() as service:
            task = asyncio.create_task(service.poll(every(service, 0.1), Log()))
            await asyncio.sleep(1.0)
            monkeypatch.setattr(service.health, "take", broken)
            world.switch_off(0)
            with pytest.raises(ZeroDivisionError):
                await task

    in_world(monkeypatch, 1, test)


# -- silence -------------------------------------------------------------------------------------


def test_a_silent_device_costs_one_time_out_and_its_probes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 0.5)) as log:
            await asyncio.sleep(5.0)
            world.switch_off(1)
            began = asyncio.get_running_loop().time()
            before = service.device("d1").counters.requests
            await asyncio.sleep(100.0)
            silent = service.device("d1").counters
            assert service.health.silent == ["d1"]
            # one poll, its first probe, then a probe whenever the allowance has grown again
            assert silent.requests - before == silent.no_reply
            assert 2 + 100 * 0.05 / 0.3 * 0.8 <= silent.no_reply <= 3 + 100 * 0.05 / 0.2
            assert silent.busy <= 0.05 * 100 + 3 * (TIME_OUT + 0.03)
            counts = log.count(began + 1.0)
            assert counts["d0", GOOD] >= 0.95 * 198
            assert counts["d2", GOOD] >= 0.95 * 198
            assert counts["d1", GOOD] == 0
            assert counts["d1", NO_REPLY] >= 195
            last = [one for _, one in log.all if one.device == "d1"][-1]
            assert isinstance(last.error, NoReply)
            assert last.value == 0  # the old value, with its own time
            assert last.reading is not None
            assert last.reading.time < last.time

    in_world(monkeypatch, 3, test)


@pytest.mark.parametrize("unplugged", [False, True])
def test_what_cannot_be_asked_is_not_said_faster_than_it_could_be_read(
    monkeypatch: pytest.MonkeyPatch, unplugged: bool
) -> None:
    """Also a plan that is much too full leaves the processor in peace."""

    async def test(world: World) -> None:
        world.switch_off(0, 1)
        async with world.service() as service, polling(service, every(service, 0.001)) as log:
            await asyncio.sleep(2.0)
            if unplugged:
                world.unplug()
            log.all.clear()
            await asyncio.sleep(10.0)
            assert {one.quality for _, one in log.all} == {PORT_LOST if unplugged else NO_REPLY}
            assert 100 <= len(log.all) <= 2 * 10.0 / TRANSACTION

    in_world(monkeypatch, 2, test)


def test_many_silent_devices_cost_no_more_than_one(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        world.switch_off(*range(10))
        async with world.service() as service, polling(service, every(service, 1.0)) as log:
            await asyncio.sleep(10.0)
            began = asyncio.get_running_loop().time()
            before = {name: device.counters.busy for name, device in service.devices.items()}
            await asyncio.sleep(200.0)
            dead = [f"d{number}" for number in range(10)]
            probes = sum(service.device(name).counters.busy - before[name] for name in dead)
            assert 0.03 * 200 <= probes <= 0.05 * 200 + 2 * TIME_OUT
            counts = log.count(began)
            for number in range(10, 20):
                assert counts[f"d{number}", GOOD] >= 0.94 * 200

    in_world(monkeypatch, 20, test)


def test_devices_that_come_back_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 1.0)) as log:
            await asyncio.sleep(3.0)
            world.switch_off(*range(6))
            await asyncio.sleep(60.0)
            assert len(service.health.silent) == 6
            world.switch_off()
            back = asyncio.get_running_loop().time()
            await asyncio.sleep(10.0)
            assert service.health.silent == []
            for name in service.devices:
                assert log.times(name)[-1] > back
            assert max(at for at, one in log.all if one.quality is NO_REPLY) < back + 7.0

    in_world(monkeypatch, 6, test)


def test_one_lost_answer_costs_one_poll(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also beside a dead device: who was there until just now is probed at once."""

    async def test(world: World) -> None:
        world.switch_off(2)
        async with world.service() as service, polling(service, every(service, 1.0)) as log:
            await asyncio.sleep(30.0)
            for _ in range(3):
                world.faults.next = [Fault.NO_ANSWER]
                await asyncio.sleep(30.0)
            for name in ("d0", "d1"):
                assert log.qualities(name).count(NO_REPLY) <= 3
            assert log.count()["d0", NO_REPLY] + log.count()["d1", NO_REPLY] <= 3
            assert service.health.silent == ["d2"]

    in_world(monkeypatch, 3, test)


def test_damage_is_asked_again_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 1.0)) as log:
            await asyncio.sleep(2.5)
            world.faults.next = [Fault.WRONG_CHECKSUM, Fault.CUT_SHORT]
            await asyncio.sleep(2.0)
            assert set(log.qualities("d0")) == {GOOD}
            counters = service.device("d0").counters
            assert (counters.damaged >= 2, counters.no_reply) == (True, 2)
            world.faults.next = [Fault.WRONG_CHECKSUM] * 3
            await asyncio.sleep(2.0)
            assert log.qualities("d0").count(NO_REPLY) == 1

    in_world(monkeypatch, 1, test)


def test_a_person_reads_a_silent_device(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        world.switch_off(0)
        async with (
            world.service(attempts=2) as service,
            polling(service, every(service, 1.0)) as log,
        ):
            await asyncio.sleep(30.0)
            requests = service.device("d0").counters.requests
            with pytest.raises(NoReply) as silence:
                await service.read("d0", POINT)
            assert silence.value.attempts == 2
            assert service.device("d0").counters.requests == requests + 2
            world.switch_off()
            (reading,) = await service.read("d0", [POINT])
            assert reading.value == 0
            assert service.health.silent == []
            await asyncio.sleep(1.5)
            assert log.qualities("d0")[-1] is GOOD

    in_world(monkeypatch, 2, test)


def test_try_now(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            assert await service.try_now("d0")  # not polled: its status is asked
            world.switch_off(0)
            assert not await service.try_now("d0")
            assert service.health.silent == []  # nobody polls it, so nobody probes it
            async with polling(service, every(service, 1.0)) as log:
                await asyncio.sleep(30.0)
                assert not await service.try_now("d0")
                world.switch_off()
                assert await service.try_now("d0")
                assert log.qualities("d0")[-1] is GOOD
                world.unplug()
                with pytest.raises(PortError, match="unplugged"):
                    await service.try_now("d0")

    in_world(monkeypatch, 1, test)


def test_when_polling_ends_probing_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        world.switch_off(0)
        async with world.service() as service:
            async with polling(service, every(service, 1.0)):
                await asyncio.sleep(5.0)
                assert service.health.silent == ["d0"]
            assert service.health.silent == []
            requests = service.counters.requests
            await asyncio.sleep(50.0)
            assert service.counters.requests == requests

    in_world(monkeypatch, 1, test)


# -- other devices on the same port ----------------------------------------------------------------


def test_devices_are_changed_on_the_open_port(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        world.switch_off(1)
        options = f"@wire,timeout={TIME_OUT}"
        async with world.service() as service:
            async with polling(service, every(service, 1.0)):
                await asyncio.sleep(5.0)
                assert service.health.silent == ["d1"]
            kept = service.device("d0")
            answers = kept.counters.answers
            service.change({"d0": f"flexmax:0{options}", "new": f"flexmax:2{options}"})
            assert service.device("d0") is kept
            async with polling(service, every(service, 1.0)) as log:
                await asyncio.sleep(5.0)
                assert log.qualities("new")[-1] is log.qualities("d0")[-1] is GOOD
            assert kept.counters.answers > answers
            assert (service.times_opened, service.health.silent) == (1, [])
            with pytest.raises(UsageError, match="no device 'd1'"):
                service.device("d1")

    in_world(monkeypatch, 3, test)


def test_what_cannot_be_changed_on_an_open_port(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            devices = dict(service.devices)
            for name in ("flexmax:0@other", "flexmax:0@wire", "flexmax:0@wire,timeout=1"):
                with pytest.raises(UsageError, match="of another line, or it has other settings"):
                    service.change([name])
            with pytest.raises(UsageError, match="at least one device"):
                service.change([])
            async with polling(service, every(service, 1.0)):
                await asyncio.sleep(0.1)
                with pytest.raises(UsageError, match="can only be changed once it is not"):
                    service.change([f"flexmax:0@wire,timeout={TIME_OUT}"])
            assert service.devices == devices

    in_world(monkeypatch, 1, test)


# -- the port ------------------------------------------------------------------------------------


def test_unplugged_and_plugged_in_again(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 0.5)) as log:
            now = asyncio.get_running_loop().time
            await asyncio.sleep(10.0)
            world.unplug()
            gone = now()
            await asyncio.sleep(30.0)
            with pytest.raises(PortError, match="no such port"):
                await service.read("d0", POINT)
            assert now() == pytest.approx(gone + 30.0)  # at once
            assert service.lost is not None
            world.plugged = True
            back = now()
            await asyncio.sleep(10.0)
            assert service.lost is None
            assert service.times_opened == 2
            for name in service.devices:
                times = log.times(name)
                first = min(at for at in times if at > gone)
                assert first < back + 1.0 + 0.5 + TRANSACTION
                lost = log.qualities(name).count(PORT_LOST)
                assert (first - gone) / 0.5 - 1 <= lost <= (first - gone) / 0.5 + 1
                assert len(times) + lost >= 50.0 / 0.5 - 2  # no poll but those of that time
            assert service.health.silent == []
            tries = [at for at in world.attempts if gone < at < back]
            pauses = [after - before for before, after in itertools.pairwise(tries)]
            assert pauses[-1] == pytest.approx(1.0, abs=1e-3)
            assert len(tries) <= 34

    in_world(monkeypatch, 2, test)


def test_a_port_that_is_not_there_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        world.plugged = False
        async with world.service() as service:
            with pytest.raises(PortError, match="cannot open wire: no such port"):
                await service.read("d0", POINT)
            world.plugged = True
            await asyncio.sleep(1.5)
            assert (await service.read("d0", POINT))[0].value == 0
            assert world.attempts[1] - world.attempts[0] == pytest.approx(0.1, abs=1e-3)

    in_world(monkeypatch, 1, test)


def test_a_port_that_comes_and_goes_is_left_in_peace(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            for _ in range(100):
                await asyncio.sleep(0.1)
                if service.lost is None:
                    world.unplug()
                    world.plugged = True
            assert service.times_opened < 15

    in_world(monkeypatch, 1, test)


def test_a_port_that_breaks_as_it_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        opened = world._open

        async def breaks(*arguments: object) -> object:
            line = await opened(*arguments)  # type: ignore[arg-type]
            line.connection_lost(OSError("gone again"))
            return line

        monkeypatch.setattr("multidrop.io.kept_port.opened", breaks)
        async with world.service() as service:
            await asyncio.sleep(0.05)
            with pytest.raises(PortError, match="gone again"):
                await service.read("d0", POINT)

    in_world(monkeypatch, 1, test)


def test_whatever_opening_raises_it_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        opened, errors = world._open, [RuntimeError("odd driver"), OSError(16, "busy")]

        async def fails(*arguments: object) -> object:
            if errors:
                raise errors.pop(0)
            return await opened(*arguments)  # type: ignore[arg-type]

        monkeypatch.setattr("multidrop.io.kept_port.opened", fails)
        async with world.service() as service:
            with pytest.raises(PortError, match="cannot open wire: odd driver"):
                await service.read("d0", POINT)
            await asyncio.sleep(1.0)
            assert (await service.read("d0", POINT))[0].value == 0

    in_world(monkeypatch, 1, test)


def test_a_port_that_cannot_even_be_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            assert world.line is not None

            async def fails() -> None:
                raise OSError(5, "Input/output error")

            monkeypatch.setattr(world.line, "close", fails)
            world.unplug()
            world.plugged = True
            await asyncio.sleep(1.0)
            assert (await service.read("d0", POINT))[0].value == 0

    in_world(monkeypatch, 1, test)


def test_counters_go_on_when_the_port_was_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            seen: list[bytes] = []
            service.taps.append(lambda data, out, now, damaged: seen.append(data))
            for _ in range(2):
                await service.read("d0", POINT)
                world.unplug()
                world.plugged = True
                await asyncio.sleep(2.0)
            assert service.counters.answers == service.counters.requests == 2
            assert service.device("d0").counters.answers == 2
            assert service.device("d1").counters.answers == 0
            assert len([data for data in seen if data[0:1] == b"\x01"]) >= 4

    in_world(monkeypatch, 2, test)


def test_a_port_that_cannot_be_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        with pytest.raises(UsageError, match="tcp://HOST:PORT"):
            async with LineService(["flexmax:0@tcp://nowhere"]):
                pass

    in_virtual_time(main)


def test_after_closing(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            await service.read("d0", POINT)
        with pytest.raises(PortError, match="wire was closed"):
            await service.read("d0", POINT)

    in_world(monkeypatch, 1, test)


# -- strangers -----------------------------------------------------------------------------------


def test_strangers_are_counted_and_never_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another master, another slave, a late answer and noise, while a device is polled."""

    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 0.5)) as log:
            await asyncio.sleep(2.2)
            assert world.line is not None
            question = slink3.Frame(0, 0, 0, 0x26, bytes.fromhex("03 2C 20"))
            answer = slink3.Frame(0, 0, 1, 0, bytes.fromhex("03 2C 20 63 00"))
            for frame in (question, answer):
                world.line.data_received(frame.encode())
            world.line.data_received(b"\x55\xaa" * 5)
            world.faults.next = [Fault.OTHER_SLAVE, Fault.LATE_ANSWER]
            await asyncio.sleep(5.0)
            assert service.counters.foreign >= 4
            assert service.counters.damaged >= 1
            assert {one.value for _, one in log.all} <= {0, None}
            assert log.qualities("d0")[-1] is GOOD
            assert service.device("d0").counters.foreign < service.counters.foreign

    in_world(monkeypatch, 1, test)


# -- who goes first ------------------------------------------------------------------------------


def test_a_person_on_a_full_line_waits_for_one_transaction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def test(world: World) -> None:
        now = asyncio.get_running_loop().time
        async with world.service() as service, polling(service, every(service, 0.02)):
            for number in range(50):
                await asyncio.sleep(0.313)
                asked = now()
                await service.read(f"d{number % 5}", POINT)
                assert now() - asked <= 2 * TRANSACTION + 0.002

    in_world(monkeypatch, 5, test)


def test_the_background_has_turns_on_a_full_line(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 0.02)) as log:
            await asyncio.sleep(1.0)
            for _ in range(10):
                await service.read("d0", POINT, Priority.BACKGROUND)
            assert len(log.all) >= 10 * 16

    in_world(monkeypatch, 3, test)


# -- writing -------------------------------------------------------------------------------------


def test_a_write_is_confirmed_and_logged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MULTIDROP_AUDIT", str(tmp_path / "audit.jsonl"))

    async def test(world: World) -> None:
        async with world.service() as service, polling(service, every(service, 0.05)):
            written = await service.write("d1", POINT, 42)
            assert written.outcome == "confirmed"
            (reading,) = await service.read("d1", POINT)
            assert reading.value == 42
            with pytest.raises(DeviceError):
                await service.write("d1", "speed_setpoint", 5000)
            assert service.device("d1").counters.refusals == 1

    in_world(monkeypatch, 2, test)
    lines = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
    assert [line["outcome"] for line in lines] == ["confirmed", "not-applied"]
    assert lines[0]["device"] == "flexmax:1@wire"


def test_a_port_that_is_lost_in_a_write(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MULTIDROP_AUDIT", str(tmp_path / "audit.jsonl"))

    async def test(world: World) -> None:
        async with world.service() as service:
            world.faults.next = [None, Fault.NO_ANSWER]
            writing = asyncio.create_task(service.write("d0", POINT, 42))
            await asyncio.sleep(0.15)
            world.unplug()
            with pytest.raises(OutcomeUnknown, match="unplugged"):
                await writing
            await asyncio.sleep(0)
            with pytest.raises(PortError):
                await service.write("d0", POINT, 43)

    in_world(monkeypatch, 1, test)
    (line,) = (tmp_path / "audit.jsonl").read_text().splitlines()
    assert json.loads(line)["outcome"] == "unknown"


# -- which devices -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("devices", "why"),
    [
        ([], "at least one device"),
        (["flexmax:0@a", "flexmax:1@b"], "not on one port"),
        (["flexmax:0@a", "ultra3000:1@a"], "differ in the settings of their line"),
        (["flexmax:0@a", "flexmax:1@a,echo=on"], "differ in the settings of their line"),
        (["flexmax:0@a", "ax-v:0@a"], "another device at this address"),
    ],
)
def test_devices_that_are_not_of_one_line(devices: list[str], why: str) -> None:
    with pytest.raises(UsageError, match=why):
        LineService(devices)


def test_a_device_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(world: World) -> None:
        async with world.service() as service:
            with pytest.raises(UsageError, match="no device 'd00' - did you mean 'd0'"):
                await service.read("d00", POINT)
            with pytest.raises(UsageError, match="no device"):
                service.plan([("x", POINT, 1.0)])

    in_world(monkeypatch, 1, test)


__all__ = ["FlexMax"]
