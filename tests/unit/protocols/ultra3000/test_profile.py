"""The profile: every row of the manual's list, as the drive's own tables have them."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.points import Role
from multidrop.profile import PointDescription
from multidrop.protocols.ultra3000 import Refusal, status
from multidrop.protocols.ultra3000.points import ParameterPoint, parse_point
from multidrop.protocols.ultra3000.values import ACTION, INTEGERS

PROFILE = load_profile("ultra3000")
POINTS = {name: parse_point(name, PROFILE, whole=True) for name in PROFILE.points}
ROLES = {
    Role.COMMAND: "004 044 061 06B 06F 071 0B8 0CD 10A",
    Role.SETPOINT: "06C 06D 06E",
    Role.COMMUNICATION: "050 051 052 053",
    Role.IDENTITY: "000 002 003 006 0EB 179",
    Role.MEASURED: "001 073 074 075 076 077 07D 07E 07F 080 081 082 083 084 085 086 087 088 089 "
    "08A 08B 08D 08E 08F 092 094 108 19E",
}
ROLE_OF = {number: role for role, numbers in ROLES.items() for number in numbers.split()}


def description(name: str) -> PointDescription:
    return PROFILE.points[name]


def test_there_are_108_parameters() -> None:
    assert len({point.parameter for point in POINTS.values()}) == len(POINTS) == 108


@pytest.mark.parametrize("point", POINTS.values(), ids=str)
def test_a_parameter_is_complete(point: ParameterPoint) -> None:
    about = point.description
    assert about is not None
    assert about.at == f"0x{point.parameter:03X}"
    assert about.role is ROLE_OF.get(about.at[2:], Role.SETTING)
    assert about.meaning
    assert about.source.startswith("p. ")
    reads, writes = "0" in about.functions, bool(set("13") & set(about.functions))
    assert about.access == "r" * reads + "w" * writes
    assert ("A" in about.functions) == (about.elements is not None)
    assert set(about.refusals) <= set(Refusal)
    if point.kind is ACTION:
        assert about.functions == "1"
        assert about.role is Role.COMMAND


@pytest.mark.parametrize(
    "point",
    [point for point in POINTS.values() if point.kind.name in INTEGERS],
    ids=str,
)
def test_limits_and_default_fit_the_type(point: ParameterPoint) -> None:
    about = point.description
    assert about is not None
    least, greatest = point.kind.limits
    for limit in (about.minimum, about.maximum, about.default):
        if limit is not None:
            raw = about.unscaled(float(limit))
            assert isinstance(raw, int | float)
            assert least <= raw <= greatest
            assert about.physical(raw) == limit
    if isinstance(about.default, int | float):
        about.check_limits(about.default)
    for raw_name in about.names:
        assert least <= int(raw_name) <= greatest
        about.check_limits(int(raw_name))


def test_views_that_the_table_lists() -> None:
    assert description("kp").functions == "0123456789"
    assert description("preset_velocity").functions == "0123456789AB"
    assert description("baud_rate").functions == "0236789"
    assert description("broadcast_address").functions == "01236789"
    assert description("drive_name").functions == "01234567"
    assert description("motor_model").functions == "012367"
    assert description("setpoint_velocity").functions == "0189"
    assert description("digital_output_override").functions == "01"


def test_physical_values() -> None:
    assert POINTS["kp"].physical(0x200) == 4
    assert POINTS["motor_intermittent_current"].physical(2560) == 20
    assert POINTS["torque_constant"].physical(2458) == 2458 / 4096
    assert POINTS["motor_inertia"].physical(49807) == 49807 / 65536
    assert POINTS["electrical_cycle_length"].physical(300) == 30.0
    assert POINTS["electrical_cycle_length"].physical(3) == 0.3
    assert POINTS["thermal_capacitance"].physical(0x0004CB00) == 1227
    assert POINTS["motor_temperature"].physical(-64) == -0.5


def test_where_the_manual_contradicts_itself() -> None:
    assert description("override_mode").maximum == 9  # C1
    assert description("index_termination").maximum == 3
    assert description("homing_type").maximum == 5
    for name in ("offset_move_distance", "home_position", "negative_soft_limit"):  # C2
        assert description(name).refusals == [3, 4, 8]
    assert description("analog_velocity_scale").type == "int16|int32"  # C3
    assert description("extended_fault_status").type == "uint16|uint32"
    assert POINTS["rotation_direction"].parameter == 0x0AB  # C4
    assert POINTS["start_homing"].kind is ACTION  # C5
    bits = description("digital_output_override").bits
    assert bits[4:6] == ["override relay", "override relay"]  # C6
    assert description("analog_output_configuration").refusals == [3, 5, 7, 8]  # C7
    assert description("force_constant").unit == "N-m/A"  # C8
    for number in range(1, 9):
        assert any(about.note.startswith(f"C{number}: ") for about in PROFILE.points.values())


def test_names_are_those_of_the_status_words() -> None:
    assert tuple(description("drive_status").bits) == status.DRIVE_STATUS
    assert tuple(description("fault_status").bits) == status.FAULT_STATUS
    assert tuple(description("extended_fault_status").bits) == status.EXTENDED_FAULT_STATUS
    names = description("run_status").names
    assert {int(code): name for code, name in names.items()} == {
        code: status.run_status(code) for code in (0, 255, *status.FAULT_CODES)
    }


def test_names_of_values() -> None:
    about = description("analog_output_configuration")
    assert about.meaning_of(0x10) == "current command"
    assert about.raw_of_name("Velocity_Error") == 0x18
    assert description("drive_status").meaning_of(0x8180) == "enabled, bus charged, ready"
    assert description("fault_status").meaning_of(0) == "none"
