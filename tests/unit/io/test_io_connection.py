"""Connections: readings in units and with their time, and what the audit log says of what was sent."""

from __future__ import annotations

import asyncio
import errno
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from integration.virtual_time import WireTransport

from multidrop.errors import (
    DeviceError,
    NoReply,
    OutcomeUnknown,
    PortError,
    UsageError,
)
from multidrop.io.async_connection import AsyncConnection
from multidrop.io.async_line import AsyncLine
from multidrop.io.audit import AuditLog
from multidrop.io.connection import Connection, Target
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.io.parity import ParityMarks
from multidrop.naming import parse_device
from multidrop.points import Role
from multidrop.profile import PointDescription, Profile
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault
from multidrop.sim.line import SimulatedLine
from unit.io.lines import asyncio_line, blocking, in_virtual_time, scripted, simulated

SCALED = PointDescription("tension", "1009:int16", Role.SETTING, unit="N", scale=0.1, maximum=20.0)
PROFILE = Profile("ax-v", "slink3", dialect="ax-v", points={"tension": SCALED})


@pytest.fixture
def log(tmp_path: Path) -> AuditLog:
    return AuditLog(tmp_path / "audit.jsonl", origin="tests")


def logged(log: AuditLog) -> list[dict[str, Any]]:
    return [json.loads(line) for line in log.path.read_text().splitlines()]


def target(who: str = "ax-v:2", profile: Profile | None = None) -> Target:
    return Target(parse_device(f"{who}@wire"), profile)


def connected(
    log: AuditLog, *faults: Any, who: str = "ax-v:2", profile: Profile | None = None
) -> Connection:
    found = target(who, profile)
    line = blocking(simulated(faults=scripted(*faults, late=0.25)))
    return Connection(found, found.device(), line, log)


def test_a_reading(log: AuditLog) -> None:
    before = datetime.now(UTC)
    reading = connected(log, Fault.LATE_ANSWER, profile=PROFILE).read("tension")
    assert (reading.point, reading.name, reading.unit) == ("1009", "tension", "N")
    assert reading.value == pytest.approx(12.5)
    assert (reading.type, reading.raw, reading.fault) == ("int16", b"\x7d\0", None)
    assert reading.ms == pytest.approx(250, abs=1)
    assert before - timedelta(seconds=1) <= reading.time <= datetime.now(UTC)


def test_a_reading_that_is_taken_from_its_point(log: AuditLog) -> None:
    connection = connected(log)
    point = connection.device.point("1009")
    assert connection.read(point).value == 125


def test_a_write_in_units(log: AuditLog) -> None:
    connection = connected(log, profile=PROFILE)
    record = connection.write("tension", 15.0)
    assert record.outcome == "confirmed"
    assert connection.read("1009").raw == b"\x96\0"
    assert logged(log)[0]["asked"] == 15.0
    with pytest.raises(UsageError, match=r"30 N is out of range for tension"):
        connection.write("tension", 30.0)
    assert len(logged(log)) == 1


def test_a_refused_write_raises_and_is_logged(log: AuditLog) -> None:
    with pytest.raises(DeviceError):
        connected(log, who="flexmax:0").write("speed_setpoint", 4000)
    assert logged(log)[0]["outcome"] == "not-applied"


def test_an_unknown_outcome_raises_and_is_logged(log: AuditLog) -> None:
    with pytest.raises(OutcomeUnknown):
        connected(log, None, *[Fault.NO_ANSWER] * 4).write("1111", 1)
    assert logged(log)[0]["outcome"] == "unknown"


def test_what_was_not_sent_is_not_logged(log: AuditLog) -> None:
    with pytest.raises(NoReply):
        connected(log, *[Fault.NO_ANSWER] * 3).write("1111", 1)
    assert logged(log) == []


def test_services_are_logged_where_they_act(log: AuditLog) -> None:
    connection = connected(log, who="flexmax:0")
    connection.clear_faults()
    assert logged(log) == []  # not in fault: nothing was written
    connection.write("65000:uint16", 0x2310)
    assert connection.clear_faults().fields["cleared"] is True
    connection.reset_comm()
    assert connection.raw("2300").fields["response"] == 0
    found = [(line["point"], line["outcome"]) for line in logged(log)[1:]]
    assert found == [
        ("clear-faults", "confirmed"),
        ("reset-comm", "unverified"),
        ("raw 2300", "unverified"),
    ]
    assert logged(log)[-1]["answer"]["data"] == "4002"


def test_a_service_without_an_answer_is_logged_as_unknown(log: AuditLog) -> None:
    with pytest.raises(NoReply):
        connected(log, Fault.NO_ANSWER, who="flexmax:0").reset_comm()
    assert [line["outcome"] for line in logged(log)] == ["unknown"]


class Lost:
    """A port that goes, or is broken off, with the first request that is not a read."""

    network = False
    marks: ParityMarks | None = None

    def __init__(self, connection: Connection, why: BaseException) -> None:
        self._port = connection.line.port
        self._why = why
        self._gone = False
        self.now = self._port.now
        self.close = self._port.close

    def write(self, data: bytes) -> None:
        self._gone = data[5] in (0x27, 0x20)
        self._port.write(data)

    def read(self, timeout: float) -> bytes:
        if self._gone and timeout > 0:
            raise self._why
        return self._port.read(timeout)


@pytest.mark.parametrize(
    "why", [PortError("unplugged"), KeyboardInterrupt()], ids=["lost", "ctrl-c"]
)
def test_what_was_in_flight_when_it_broke_off_is_unknown(log: AuditLog, why: BaseException) -> None:
    reason = "unplugged" if isinstance(why, PortError) else "interrupted"
    connection = connected(log, who="flexmax:0")
    connection.line.port = Lost(connection, why)
    with pytest.raises(OutcomeUnknown, match=f"went out, then: {reason}"):
        connection.write("8236", 1)
    connection = connected(log, who="flexmax:0")
    connection.line.port = Lost(connection, why)
    with pytest.raises(OutcomeUnknown, match=f"reset-comm went out, then: {reason}"):
        connection.reset_comm()
    assert [line["outcome"] for line in logged(log)] == ["unknown", "unknown"]
    assert logged(log)[1]["error"] == reason


class OnWire(AsyncConnection):
    """Opened on a simulated wire."""

    faults: tuple[Any, ...] = ()

    async def __aenter__(self) -> OnWire:
        self.line = asyncio_line(simulated(faults=scripted(*self.faults, late=0.25)))
        return self


def on_wire(log: AuditLog, *faults: Any, who: str = "flexmax:0") -> OnWire:
    found = target(who)
    connection = OnWire(found, found.device(), log)
    connection.faults = faults
    return connection


def test_asyncio_does_the_same(log: AuditLog) -> None:
    async def main() -> None:
        async with on_wire(log) as drive:
            record = await drive.write("8236", 5)
            assert record.outcome == "confirmed"
            assert (await drive.read("8236")).value == 5
            assert (await drive.status()).fields["fault"] is False
            await drive.clear_faults()
            await drive.reset_comm()
            with pytest.raises(DeviceError):
                await drive.write("speed_setpoint", 4000)
        assert [line["outcome"] for line in logged(log)] == [
            "confirmed",
            "unverified",
            "not-applied",
        ]

    in_virtual_time(main)


SLOW = (None, Fault.LATE_ANSWER)
"""The answer to the old value comes at once, that to what is sent then does not."""


def test_a_write_that_is_cancelled_in_flight_is_logged_as_unknown(log: AuditLog) -> None:
    async def main() -> None:
        async with on_wire(log, *SLOW) as drive:
            writing = asyncio.ensure_future(drive.write("8236", 5))
            await asyncio.sleep(0.1)
            writing.cancel()
            with pytest.raises(asyncio.CancelledError):
                await writing
        assert [line["outcome"] for line in logged(log)] == ["unknown"]

    in_virtual_time(main)


def test_a_write_that_is_cancelled_before_its_turn_is_not_logged(log: AuditLog) -> None:
    async def main() -> None:
        async with on_wire(log, *SLOW) as drive:
            first = asyncio.ensure_future(drive.write("8236", 5))
            second = asyncio.ensure_future(drive.write("8236", 6))
            await asyncio.sleep(0.1)
            second.cancel()
            with pytest.raises(asyncio.CancelledError):
                await second
            assert (await first).outcome == "confirmed"
        assert [(line["asked"], line["outcome"]) for line in logged(log)] == [(5, "confirmed")]

    in_virtual_time(main)


def test_a_line_that_is_lost_in_the_middle_of_a_write(log: AuditLog) -> None:
    async def main() -> None:
        async with on_wire(log, *SLOW) as drive:
            writing = asyncio.ensure_future(drive.write("8236", 5))
            await asyncio.sleep(0.1)
            drive.line.connection_lost(OSError("unplugged"))
            with pytest.raises(OutcomeUnknown, match="unplugged"):
                await writing
        assert [line["outcome"] for line in logged(log)] == ["unknown"]

    in_virtual_time(main)


def servo(*faults: Any) -> tuple[Target, SimulatedLine]:
    """An Ultra3000, and the line that it is on."""
    found = Target(parse_device("ultra3000:0@wire,echo=off"))
    devices = [simulated_device("ultra3000", 0)]
    return found, SimulatedLine(
        devices, found.settings.decoder, faults=scripted(*faults, late=0.25)
    )


def homing(log: AuditLog) -> Connection:
    found, wire = servo()
    line = Line(MemoryPort(wire.attach()), found.settings, found.options)
    return Connection(found, found.device(), line, log)


def homing_on_asyncio(log: AuditLog, *faults: Any) -> AsyncConnection:
    """To be called in a running loop."""
    found, wire = servo(*faults)
    connection = AsyncConnection(found, found.device(), log)
    connection.line = AsyncLine(found.settings, found.options, network=False)
    WireTransport(wire.attach(), connection.line)
    return connection


def test_actions_and_copies_are_logged(log: AuditLog) -> None:
    connection = homing(log)
    connection.act("define_home")
    (record,) = connection.copy(connection.prepare_copy("kp", save=True))
    assert record.outcome == "confirmed"
    assert [(line["point"], line["outcome"]) for line in logged(log)] == [
        ("define_home", "confirmed"),
        ("0x011@nv", "confirmed"),
    ]


class LostOnCopy(Lost):
    def write(self, data: bytes) -> None:
        self._gone = data[6:7] == b"5"  # the function: working to saved value
        self._port.write(data)


@pytest.mark.parametrize("why", [PortError("unplugged"), KeyboardInterrupt()])
def test_a_copy_that_was_in_flight_when_it_broke_off(log: AuditLog, why: BaseException) -> None:
    connection = homing(log)
    connection.line.port = LostOnCopy(connection, why)
    with pytest.raises(OutcomeUnknown, match=r"save kp .* went out, then: (unplu|interru)"):
        connection.copy(connection.prepare_copy("kp", save=True))
    assert [line["outcome"] for line in logged(log)] == ["unknown"]


def test_a_copy_whose_value_cannot_be_read_is_neither_sent_nor_logged(log: AuditLog) -> None:
    connection = homing(log)
    connection.line.port = MemoryPort(SimulatedLine([], connection.line.settings.decoder).attach())
    with pytest.raises(NoReply):
        connection.copy(connection.prepare_copy("kp", save=True))
    assert logged(log) == []


def test_asyncio_acts_and_copies_too(log: AuditLog) -> None:
    async def main() -> None:
        connection = homing_on_asyncio(log)
        await connection.act("define_home")
        (record,) = await connection.copy(connection.prepare_copy("kp", save=True))
        assert record.outcome == "confirmed"

    in_virtual_time(main)
    assert [line["outcome"] for line in logged(log)] == ["confirmed", "confirmed"]


def test_a_copy_that_is_cancelled_in_flight_is_logged_as_unknown(log: AuditLog) -> None:
    async def main() -> None:
        connection = homing_on_asyncio(log, None, None, None, Fault.LATE_ANSWER)
        copy = connection.prepare_copy("kp", save=False)
        copying = asyncio.ensure_future(connection.copy(copy))
        await asyncio.sleep(0.1)
        copying.cancel()
        with pytest.raises(asyncio.CancelledError):
            await copying

    in_virtual_time(main)
    assert [(line["point"][:4], line["outcome"]) for line in logged(log)] == [("load", "unknown")]


def test_nothing_goes_out_where_the_log_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    unwritable = AuditLog(tmp_path / "file" / "log", origin="tests")
    connection = connected(unwritable, who="flexmax:0")
    for call in (
        lambda: connection.write("8236", 1),
        connection.clear_faults,
        connection.reset_comm,
        lambda: connection.raw("2300"),
    ):
        with pytest.raises(UsageError, match="cannot be written"):
            call()
    assert connection.line.counters.requests == 0
    assert connection.read("8236").value == 0


class FullLog(AuditLog):
    """A log whose disk became full behind the look at it."""

    def append(self, device: str, point: str, **facts: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_what_went_out_and_could_not_be_recorded_is_not_called_done(tmp_path: Path) -> None:
    connection = connected(FullLog(tmp_path / "log", origin="tests"), who="flexmax:0")
    for call, what in (
        (lambda: connection.write("8236", 77), r"index_8236 \(8236\): the write \(confirmed\)"),
        (lambda: connection.raw("0020"), "raw 0020"),
    ):
        with pytest.raises(OutcomeUnknown, match=rf"{what} went out and could not be recorded: "):
            call()
    assert connection.read("8236").value == 77


def test_an_asyncio_write_that_could_not_be_recorded(tmp_path: Path) -> None:
    async def main() -> None:
        async with on_wire(FullLog(tmp_path / "log", origin="tests")) as drive:
            with pytest.raises(OutcomeUnknown, match="could not be recorded"):
                await drive.write("8236", 77)

    in_virtual_time(main)
