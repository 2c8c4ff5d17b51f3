"""The simulated Ultra3000: every row of its profile, as the profile describes it, and a servo that moves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.device import KeepsMemory, ReadsAll
from multidrop.errors import DeviceError, NoReply, NotApplied, UsageError
from multidrop.io.audit import AuditLog
from multidrop.io.connection import Connection, Target
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.profile import PointDescription
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.ultra3000 import Master, Refusal
from multidrop.sim.line import Pace, SimulatedLine
from multidrop.sim.ultra3000 import TRIP, SimulatedUltra3000
from multidrop.writing import Outcome

LINE = PROTOCOLS["ultra3000"].line
POINTS = load_profile("ultra3000").points
KEPT = [item for item in POINTS.values() if "2" in item.functions and "1" in item.functions]


def connection_to(drive: SimulatedUltra3000, path: Path) -> Connection:
    pace = Pace(LINE.character, answer_delay=0.002)
    port = MemoryPort(SimulatedLine([drive], LINE.decoder, pace=pace).attach())
    target = Target.of("ultra3000:0@memory")
    return Connection(target, target.device(), Line(port, LINE), AuditLog(path, origin="test"))


@pytest.fixture
def drive() -> SimulatedUltra3000:
    return SimulatedUltra3000(0, load_profile("ultra3000"))


@pytest.fixture
def connection(drive: SimulatedUltra3000, tmp_path: Path) -> Iterator[Connection]:
    with connection_to(drive, tmp_path / "audit.jsonl") as opened:
        yield opened


def let_pass(connection: Connection, seconds: float) -> None:
    assert connection.line.port.read(seconds) == b""


def number(item: PointDescription) -> int:
    return int(item.at, 16)


def first(item: PointDescription) -> str:
    """The point itself, or the first element of an array."""
    return f"{item.name}.0" if item.elements else item.name


def test_all_108_rows_are_there() -> None:
    assert len(POINTS) == 108


def test_every_readable_point_is_read(connection: Connection) -> None:
    assert isinstance(connection.device, ReadsAll)
    points = connection.device.readable()
    assert {point.name for point in points} == {
        item.name for item in POINTS.values() if "0" in item.functions
    }
    for point in points:
        assert connection.read(point).point == point.text


@pytest.mark.parametrize("item", KEPT, ids=lambda item: item.name)
def test_a_kept_point_has_its_default_and_takes_it_back(
    item: PointDescription, connection: Connection
) -> None:
    point = first(item)
    default = connection.read(f"{point}@default").value
    if item.type != "string":
        assert default == pytest.approx(item.default)
    assert connection.write(point, default, force=True).outcome is Outcome.CONFIRMED


@pytest.mark.parametrize(
    "item", [item for item in KEPT if "8" in item.functions], ids=lambda item: item.name
)
def test_limits_are_read_and_what_is_beyond_is_refused(
    item: PointDescription, connection: Connection
) -> None:
    point = first(item)
    low, high = connection.read(f"{point}@min").value, connection.read(f"{point}@max").value
    assert low == pytest.approx(0 if item.minimum is None else item.minimum)
    assert high == pytest.approx(0xFF if item.maximum is None else item.maximum)
    above = high + item.scale if isinstance(high, int | float) else 0
    with pytest.raises(UsageError):
        connection.write(point, above)
    with pytest.raises((DeviceError, UsageError)) as refused:
        connection.write(point, above, force=True)
    if isinstance(refused.value, DeviceError):
        assert refused.value.code == Refusal.ABOVE_MAXIMUM
    else:  # the type ends where the limit does
        assert "does not fit" in str(refused.value)


@pytest.mark.parametrize(
    "item",
    [item for item in POINTS.values() if "1" not in item.functions],
    ids=lambda item: item.name,
)
def test_what_cannot_be_written_is_refused_by_the_drive_too(
    item: PointDescription, connection: Connection
) -> None:
    with pytest.raises(DeviceError) as refused:
        connection.line.run(Master(0).write(number(item), "00"))
    assert refused.value.code == Refusal.INVALID_FUNCTION


def test_an_unknown_parameter_is_an_invalid_function(connection: Connection) -> None:
    with pytest.raises(DeviceError) as refused:
        connection.read("0x7FE")
    assert refused.value.code == Refusal.INVALID_FUNCTION


def test_an_array_has_bounds(connection: Connection) -> None:
    connection.write("preset_velocity.7", 1234)
    assert connection.read("preset_velocity.7").value == 1234
    assert connection.read("preset_velocity.6").value == 0
    with pytest.raises(DeviceError) as refused:
        connection.line.run(Master(0).read(0x05B, 8))
    assert refused.value.code == Refusal.INVALID_INDEX


def test_working_and_saved_values_are_apart(connection: Connection) -> None:
    connection.write("kp", 5.0)
    assert connection.read("kp@nv").value == 4.0
    assert isinstance(connection.device, KeepsMemory)
    connection.copy(connection.device.prepare_copy("kp", save=True))
    assert connection.read("kp@nv").value == 5.0
    connection.write("kp", 6.0)
    connection.copy(connection.device.prepare_copy("kp", save=False))
    assert connection.read("kp").value == 5.0


def test_enabled_it_follows_its_setpoint_and_disabled_it_stops(
    connection: Connection, drive: SimulatedUltra3000
) -> None:
    connection.write("setpoint_velocity", 100_000)
    assert connection.read("motor_velocity").value == 0
    connection.write("drive_enable", 1)
    let_pass(connection, 1.0)
    assert connection.read("motor_velocity").value == 100_000
    position = connection.read("motor_position").value
    let_pass(connection, 1.0)
    moved = connection.read("motor_position").value
    assert isinstance(position, int)
    assert isinstance(moved, int)
    assert moved - position == pytest.approx(100_000, rel=0.02)
    assert connection.status().fields["enabled"] is True
    connection.write("drive_enable", 0)
    let_pass(connection, 1.0)
    assert connection.read("motor_velocity").value == 0
    assert drive.servo.enabled is False


def test_while_enabled_a_factory_reset_is_refused(connection: Connection) -> None:
    connection.write("kp", 5.0)
    connection.write("drive_enable", 1)
    with pytest.raises(DeviceError) as refused:
        connection.act("factory_reset")
    assert refused.value.code == Refusal.DRIVE_ENABLED
    connection.write("drive_enable", 0)
    connection.act("factory_reset")
    assert connection.read("kp").value == 4.0


def test_a_fault_disables_is_named_and_can_be_cleared(
    connection: Connection, drive: SimulatedUltra3000
) -> None:
    connection.write("drive_enable", 1)
    connection.line.run(Master(0).write(TRIP, "00000008"))
    fields: dict[str, Any] = connection.status().fields
    assert fields["enabled"] is False
    assert fields["faults"] == ["motor thermostat"]
    assert fields["malfunction_code"] == 4
    connection.clear_faults()
    assert drive.servo.faults == 0


def test_a_fault_whose_cause_is_still_there_is_not_reported_as_cleared(
    connection: Connection, drive: SimulatedUltra3000
) -> None:
    drive.servo.cause = 0x08
    connection.line.run(Master(0).write(TRIP, "00000008"))
    with pytest.raises(NotApplied, match="motor thermostat"):
        connection.clear_faults()


def test_a_new_address_acts_on_a_reset_of_the_serial_port(
    connection: Connection, tmp_path: Path, drive: SimulatedUltra3000
) -> None:
    connection.write("drive_address@nv", 7)
    assert connection.read("kp").value == 4.0
    connection.act("reset_serial_port")
    assert drive.address == 7
    with pytest.raises(NoReply):
        connection.read("kp")
    assert connection.line.run(Master(7).read(0x011)) == "0200"


def test_homing_brings_the_position_to_home(connection: Connection) -> None:
    connection.write("home_position", 500)
    connection.act("define_home")
    assert connection.read("motor_position").value == 500


def test_a_broadcast_is_carried_out_and_not_answered(
    connection: Connection,
) -> None:
    connection.line.run(Master(0).broadcast_write(0x011, "0300"))
    assert connection.line.port.read(1.0) == b""
    assert connection.read("kp").value == 6.0
