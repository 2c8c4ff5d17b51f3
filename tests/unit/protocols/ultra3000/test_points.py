"""Points: the grammar, names, arrays, views, and what a profile forbids."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.points import Role
from multidrop.profile import PointDescription, Profile
from multidrop.protocols.ultra3000 import Function, View
from multidrop.protocols.ultra3000.points import ParameterPoint, parse_point

PROFILE = load_profile("ultra3000")
BARE = Profile("bare", "ultra3000")


def found(text: str, profile: Profile = PROFILE) -> ParameterPoint:
    return parse_point(text, profile)


@pytest.mark.parametrize(
    ("text", "canonical", "name"),
    [
        ("0x06D", "0x06D", "setpoint_velocity"),
        ("0x6d", "0x06D", "setpoint_velocity"),
        (" 0X06D@working ", "0x06D", "setpoint_velocity"),
        ("0x05B.7", "0x05B.7", "preset_velocity"),
        ("0x05B.0x7@NV", "0x05B.7@nv", "preset_velocity"),
        ("0x011@default", "0x011@default", "kp"),
        ("kp@min", "0x011@min", "kp"),
        ("preset_velocity.3@max", "0x05B.3@max", "preset_velocity"),
        ("0x123", "0x123", None),
        ("0x123.4@nv", "0x123.4@nv", None),
        ("reset_faults", "0x06F", "reset_faults"),
    ],
)
def test_a_point(text: str, canonical: str, name: str | None) -> None:
    point = found(text)
    assert (point.text, point.name) == (canonical, name)


def test_a_point_has_what_the_profile_says() -> None:
    point = found("preset_current.2")
    assert (point.type, point.unit, point.role, point.elements) == ("int16", "A", Role.SETTING, 8)
    assert point.kind.digits == 4
    assert str(point) == "preset_current (0x05C.2)"
    assert point.raw_text(b"00F0") == "00F0"
    unknown = found("0x123")
    assert (unknown.type, unknown.role, unknown.elements) == (None, Role.UNKNOWN, None)


def test_views_have_functions() -> None:
    assert [view.read for view in View] == [0, 2, 6, 8, 9]
    assert View.WORKING.write is Function.WRITE_WORKING
    assert View.NV.write is Function.WRITE_NON_VOLATILE
    assert View.MAX.write is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("100", r"'100' is not a point: .* 0x100 if 100 is hex, as in the manual, or 0x064 if it"),
        ("100.2@nv", r"0x100.2@nv if 100 is hex, as in the manual, or 0x064.2@nv"),
        ("6D", r"'6D' is not a point: a parameter is written with 0x: 0x06D if 6D is hex"),
        ("0x800", "0x800 .* out of range: 0x000..0x7FF"),
        ("0x123.256", "element 256 .* out of range"),
        ("0x011@nvv", r"'nvv' is no view - did you mean 'nv'\?; views are working, nv, default"),
        ("kq", r"ultra3000 has no point 'kq' - did you mean 'kp'\?; a point is 0xPARAMETER"),
        ("0x011:int16", "'0x011:int16' is not a point: 0xPARAMETER"),
        ("", "'' is not a point"),
        ("kp.1", "'kp.1': kp is no array"),
        ("0x011.1", "kp is no array"),
        ("0x05B", r"'0x05B' is an array: name an element, 0x05B.0 to .7"),
        ("preset_velocity@nv", r"name an element, preset_velocity.0 to .7"),
        ("0x05B.8", r"preset_velocity has elements 0..7"),
        ("0x0B3.64", r"has elements 0..63"),
        ("drive_status@nv", "drive_status has no nv value"),
        ("setpoint_velocity@default", "setpoint_velocity has no default value"),
        ("drive_name@min", "drive_name has no min value"),
        ("reset_faults@nv", "reset_faults is an action, it has no values"),
        ("reset_faults.1", "reset_faults is no array"),
    ],
)
def test_a_point_that_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        found(text)


def test_without_a_profile_everything_is_hex() -> None:
    point = found("0x05B.7@nv", BARE)
    assert point.type is None
    assert point.offers(Function.WRITE_NON_VOLATILE)


def test_a_users_own_names_have_the_type_of_their_parameter() -> None:
    own = Profile(
        "own",
        "ultra3000",
        points={
            "third": PointDescription("third", "0x05B.3@nv", Role.SETTING),
            "tenths": PointDescription("tenths", "0x123", scale=0.1, unit="V"),
            "speed": PointDescription("speed", "0x085", unit="rpm", scale=0.5),
            "current": PointDescription("current", "0x087"),
            **PROFILE.points,
        },
    )
    third = found("third", own)
    assert (third.text, third.type, third.element, third.view) == (
        "0x05B.3@nv",
        "int32",
        3,
        View.NV,
    )
    assert found("third.4@working", own).text == "0x05B.4"
    assert found("0x05B.3", own).name == "third"
    assert found("0x05B.4", own).name == "preset_velocity"
    speed, current = found("speed", own), found("current", own)
    assert (speed.unit, speed.physical(10)) == ("rpm", 5)
    assert (current.unit, current.physical(128)) == ("A", 1)
    assert found("tenths", own).type is None


def test_a_profile_whose_points_are_none() -> None:
    wrong = Profile("wrong", "ultra3000", points={"x": PointDescription("x", "123")})
    with pytest.raises(UsageError, match="point x: at = '123' is not 0xPARAMETER"):
        found("x", wrong)
