"""multidrop.toml: what it says, and what is wrong with it by file, key and reason."""

from __future__ import annotations

from pathlib import Path

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.plantfile import Plant, load_plant, parse_plant
from multidrop.points import Role

PLANT = """
[line.press]
port = "/dev/ttyUSB0"
baud = 19200
[line.press.device.infeed]
profile = "flexmax"
address = 0
[line.press.device.infeed.points]
speed = { at = "8237:int16", every = 0.5, unit = "rpm", write = { min = 0, max = 1500 } }
torque = "8238:int16"
start = "std/0x6040.0:uint16"
setpoint = { at = "speed_setpoint", meaning = "of the infeed" }
[line.press.device.unwinder]
profile = "ax-v"
address = 2
"""


def plant(text: str = PLANT) -> Plant:
    return parse_plant(text, "plant.toml", load_profile)


def test_a_device_has_its_line_port_keys_and_profile() -> None:
    infeed = plant().find("infeed")
    assert (infeed.line, infeed.device.port, infeed.device.address) == ("press", "/dev/ttyUSB0", 0)
    assert infeed.device.options == {"baud": "19200"}
    assert infeed.profile.dialect == "flexmax"


def test_its_points_come_before_those_of_the_profile() -> None:
    points = plant().find("infeed").profile.points
    assert list(points)[:4] == ["speed", "torque", "start", "setpoint"]
    assert "actual_speed" in points


def test_a_point_has_unit_limits_and_period() -> None:
    infeed = plant().find("infeed")
    speed = infeed.profile.points["speed"]
    assert (speed.unit, speed.minimum, speed.maximum) == ("rpm", 0, 1500)
    assert infeed.every == {"speed": 0.5, "torque": 1.0, "start": 1.0, "setpoint": 1.0}


def test_a_point_of_the_profile_keeps_its_role_under_another_name() -> None:
    points = plant().find("infeed").profile.points
    assert points["start"].role is Role.COMMAND
    assert points["setpoint"].role is Role.SETPOINT
    assert points["setpoint"].at == "std/0x6042.0:int16"
    assert points["setpoint"].meaning == "of the infeed"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[line.press]", "[lines.press]", "plant.toml: unknown key 'lines' - did you mean 'line'"),
        ('port = "/dev/ttyUSB0"', "", "line.press.port is missing"),
        ('profile = "flexmax"', 'profile = "flexmx"', "did you mean 'flexmax'"),
        ('profile = "flexmax"', "", "infeed.profile is missing"),
        ("address = 0", "adress = 0", "unknown key 'adress' - did you mean 'address'"),
        ("address = 0", 'address = "0"', "infeed.address is missing or not a whole number"),
        ("address = 2", "address = 0", "infeed and unwinder have the same address 0 on line press"),
        ('"8238:int16"', "8238", "points.torque is neither a point nor a table"),
        ("every = 0.5", "evry = 0.5", "points.speed: unknown key 'evry' - did you mean 'every'"),
        ("every = 0.5", "every = 0", "points.speed.every is 0, which is not a number above 0"),
        ("{ min = 0, max = 1500 }", "{ maxi = 1 }", "write: unknown key 'maxi'"),
        ("{ min = 0, max = 1500 }", "true", "speed.write is not { min = ..., max = ... }"),
        ('unit = "rpm"', 'role = "motion"', "role 'motion' is none of: setting, setpoint"),
        ("[line.press.device.unwinder]", "[line.press.device.infeed2]\nx = 1", "unknown key 'x'"),
        (PLANT, "line = 1", "plant.toml: line is not a table"),
        (PLANT, "[line]\nx = 1", "line.x is not a table"),
        (PLANT, "line = [", "plant.toml: not TOML"),
    ],
)
def test_what_is_wrong_is_named(old: str, new: str, message: str) -> None:
    with pytest.raises(UsageError) as refused:
        plant(PLANT.replace(old, new, 1))
    assert message in str(refused.value)


def test_two_lines_cannot_have_one_port() -> None:
    with pytest.raises(UsageError, match="is the port of another line too"):
        plant(PLANT + '[line.other]\nport = "/dev/ttyUSB0"\n')


def test_two_devices_cannot_have_one_name() -> None:
    other = '[line.b]\nport = "x"\n[line.b.device.infeed]\nprofile = "ax-v"\naddress = 1\n'
    with pytest.raises(UsageError, match="there is another device of this name"):
        plant(PLANT + other)


def test_an_unknown_device_is_answered_with_the_nearest() -> None:
    with pytest.raises(UsageError, match=r"no device 'infed' - did you mean 'infeed'\?; it has"):
        plant().find("infed")


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="No such file"):
        load_plant(tmp_path / "none.toml", load_profile)
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(UsageError, match="not UTF-8"):
        load_plant(tmp_path / "bytes.toml", load_profile)
