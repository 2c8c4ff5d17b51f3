"""Device models as data."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.catalog import load_profile, profile_names
from multidrop.errors import UsageError
from multidrop.points import Role
from multidrop.profile import PointDescription, Profile, nearest

GOOD = """
[profile]
name = "press"
protocol = "slink3"
dialect = "flexmax"
baud = 19200
inferred = { p = 8192 }

[points.speed]
at = "8237:int16"
role = "setpoint"
unit = "rpm"
scale = 0.1
minimum = 0
maximum = 1500
"""


def test_a_profile_from_its_text() -> None:
    profile = Profile.from_toml(GOOD, "press.toml")
    assert (profile.name, profile.protocol, profile.dialect) == ("press", "slink3", "flexmax")
    assert (profile.baud, profile.inferred) == (19200, {"p": 8192})
    speed = profile.find("speed")
    assert speed is not None
    assert (speed.name, speed.at, speed.role) == ("speed", "8237:int16", Role.SETPOINT)
    assert (speed.minimum, speed.maximum, speed.access) == (0, 1500, "rw")
    assert profile.find("torque") is None
    assert profile.nearest_name("sped") == " - did you mean 'speed'?"
    assert profile.nearest_name("xyz") == ""


def test_every_shipped_profile_can_be_loaded() -> None:
    assert {"slink3", "flexmax", "ax-v", "dgfc386"} <= set(profile_names())
    for name in profile_names():
        assert load_profile(name).name == name


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[profile]", "[profile", "press.toml: not TOML"),
        ("[profile]", "x = 1\n[profile]", "press.toml: unknown key 'x'"),
        ("[profile]", "point = 1\n[profile]", "unknown key 'point' - did you mean 'points'?"),
        ("[profile]", "[[profile]]", r"a \[profile\] table and \[points.NAME\] tables"),
        ("[points.speed]", "[[points]]", r"a \[profile\] table and \[points.NAME\] tables"),
        ("[points.speed]", "[points]\ntorque = 5\n[points.speed]", "points.torque is not a table"),
        ('name = "press"', "", "profile.name is missing"),
        ('protocol = "slink3"', "", "profile.protocol is missing"),
        ("baud = 19200", "bauds = 19200", "profile: unknown key 'bauds' - did you mean 'baud'?"),
        ("baud = 19200", 'baud = "19200"', "profile.baud is '19200', which is not a int | None"),
        ("baud = 19200", "baud = true", "profile.baud is True"),
        ("p = 8192", 'p = "8192"', "profile.inferred holds '8192'"),
        ("p = 8192", "p = true", "profile.inferred holds True"),
        ('at = "8237:int16"', "", "points.speed.at is missing"),
        ('at = "8237:int16"', "at = 8237", "points.speed.at is 8237, which is not a str"),
        ('"setpoint"', '"point"', "points.speed.role 'point' is none of: setting, setpoint"),
        ('unit = "rpm"', 'access = "x"', "points.speed.access 'x' is none of: r, w, rw"),
        ("scale = 0.1", "scale = 0", "points.speed.scale must not be 0"),
        ("scale = 0.1", "scal = 1", "points.speed: unknown key 'scal' - did you mean 'scale'?"),
        ('unit = "rpm"', "names = { on = '1' }", "points.speed.names: 'on' is not a raw value"),
        ('unit = "rpm"', "names = { 1 = 1 }", "points.speed.names holds 1"),
        ('unit = "rpm"', "names = { '٢' = 'on' }", "points.speed.names: '٢' is not a raw value"),
        ('unit = "rpm"', "bits = [1]", r"points.speed.bits holds 1, which makes it no list\[str\]"),
        ('unit = "rpm"', "bits = 'on'", "points.speed.bits is 'on'"),
    ],
)
def test_a_wrong_profile_names_file_key_and_reason(old: str, new: str, message: str) -> None:
    assert old in GOOD
    with pytest.raises(UsageError, match=message.replace("|", r"\|").replace("?", r"\?")) as raised:
        Profile.from_toml(GOOD.replace(old, new), "press.toml")
    assert str(raised.value).startswith("press.toml: ")


def point(**given: Any) -> PointDescription:
    return PointDescription("speed", "8237:int16", **given)


@pytest.mark.parametrize(
    ("scale", "raw", "value"),
    [
        (1.0, 5, 5),
        (0.1, 3, 0.3),
        (0.1, 123, 12.3),
        (10.0, 5, 50.0),
        (0.25, -2, -0.5),
        (3.0, 2, 6.0),
    ],
)
def test_physical_and_raw_values(scale: float, raw: int, value: float) -> None:
    description = point(scale=scale)
    assert description.physical(raw) == value
    assert description.unscaled(value) == raw
    assert isinstance(description.unscaled(value), int)


def test_a_raw_value_is_the_nearest_step() -> None:
    assert point(scale=0.1).unscaled(0.36) == 4
    assert point(scale=10.0).unscaled(14.0) == 1


def test_a_float_point_keeps_its_fraction() -> None:
    assert point(scale=10.0).unscaled(12.5, whole=False) == 1.25


@pytest.mark.parametrize("value", ["text", b"\x01", True])
def test_what_has_no_scale(value: Any) -> None:
    assert point(scale=0.1).physical(value) == value
    assert point(scale=0.1).unscaled(value) == value


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_no_number_has_no_step(value: float) -> None:
    with pytest.raises(UsageError, match="is no value for speed"):
        point(scale=0.1).unscaled(value)


@pytest.mark.parametrize(
    ("given", "value"),
    [
        ({}, 1e9),
        ({"minimum": 0}, 0),
        ({"maximum": 5}, 5),
        ({"maximum": 5}, "text"),
        ({"step": 0.5}, 1.5),
        ({"excluded": [3]}, 4),
    ],
)
def test_values_that_the_profile_allows(given: dict[str, Any], value: Any) -> None:
    description = point(**given)
    description.check_limits(value)
    assert description == point(**given)


@pytest.mark.parametrize(
    ("given", "value", "message"),
    [
        ({"minimum": 0, "unit": "rpm"}, -1, "-1 rpm is out of range for speed: 0.. rpm"),
        ({"maximum": 5}, 99999.0, "99999 is out of range for speed: ..5"),
        ({"maximum": 5}, 5.5, "5.5 is out of range for speed: ..5"),
        ({"minimum": 0, "maximum": 5}, 6, "6 is out of range for speed: 0..5"),
        ({"step": 0.5}, 1.25, "1.25 is no value for speed: multiples of 0.5"),
        ({"excluded": [3]}, 3, "3 is no value for speed"),
    ],
)
def test_values_that_it_does_not(given: dict[str, Any], value: Any, message: str) -> None:
    with pytest.raises(UsageError) as raised:
        point(**given).check_limits(value)
    assert str(raised.value) == message


def test_names_of_values() -> None:
    mode = point(names={"0": "stop", "1": "run_fast"})
    assert mode.raw_of_name(" Run  fast") == 1
    assert mode.raw_of_name("run slow") is None
    assert mode.meaning_of(1) == "run_fast"
    assert mode.meaning_of(2) is None
    assert mode.meaning_of(1.0) is None
    assert point().meaning_of(1) is None


def test_names_of_bits() -> None:
    flags = point(bits=["ready", "", "fault"])
    assert flags.meaning_of(0b101) == "ready, fault"
    assert flags.meaning_of(0b010) == "none"
    assert flags.meaning_of("5") is None


def test_codes_that_manuals_print_in_hex() -> None:
    code = point(hexadecimal=True)
    assert code.meaning_of(0x2310) == "2310h"
    assert code.meaning_of(0) == "0000h"
    assert code.meaning_of("2310") is None


def test_the_nearest_word() -> None:
    assert nearest("sped", ["speed", "torque"]) == " - did you mean 'speed'?"
    assert nearest("xyz", ["speed"]) == ""


def test_what_is_no_number_is_within_no_limits() -> None:
    with pytest.raises(UsageError, match="nan is no value for kp"):
        PointDescription("kp", "0x011").check_limits(float("nan"))
