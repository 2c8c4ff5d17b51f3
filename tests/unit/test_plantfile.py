"""multidrop.toml: what it says, and what is wrong with it by file, key and reason."""

from __future__ import annotations

from pathlib import Path

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.plantfile import Limits, Plant, PlantPoint, load_plant, parse_plant, survey
from multidrop.points import Role
from multidrop.protocols import PROTOCOLS

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


def test_a_name_of_the_profile_is_where_it_is() -> None:
    found = plant(PLANT.replace('"8238:int16"', '"8238:int16"\nstatus_word = { every = 5 }', 1))
    point = found.devices["infeed"].points["status_word"]
    assert (point.at, point.every) == ("status_word", 5)
    elsewhere = plant(
        PLANT.replace('"8238:int16"', '"8238:int16"\nstatus_word = { at = "8239:int16" }', 1)
    )
    assert elsewhere.devices["infeed"].points["status_word"].at == "8239:int16"


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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (", max = 1500", "", "speed.write.max is missing or not a number"),
        ("max = 1500", 'max = "1"', "speed.write.max is missing or not a number"),
        ("max = 1500", "max = inf", "speed.write.max is missing or not a number"),
        ("max = 1500", "max = -1", "speed.write: min 0 is above max -1"),
        ("max = 1500", "max = 1, rate = -1", "write.rate is -1, which is not a number of 0 or"),
        ("every = 0.5", 'motion = "yes"', "speed.motion is 'yes', which is neither true nor false"),
        (
            "every = 0.5",
            "deadband = -1",
            "speed.deadband is -1, which is not a number of 0 or more",
        ),
        ("every = 0.5", "longest = 0", "speed.longest is 0, which is not a number above 0"),
        ("every = 0.5", "every = nan", "speed.every is nan, which is not a number above 0"),
        ("every = 0.5", "fault = 0", "speed.fault is 0, which is not the bits that say a fault"),
        ("every = 0.5", "fault = true", "speed.fault is True, which is not the bits"),
        ("address = 0", "address = 0\non_fault = 3", "infeed.on_fault is not a list of points"),
        ("address = 0", "address = 0\non_fault = [3]", "infeed.on_fault is not a list of points"),
        ("address = 0", "address = true", "infeed.address is missing or not a whole number"),
        (
            '"8238:int16"',
            '{ at = "address", write = { min = 0, max = 200 } }',
            "200 is out of range",
        ),
    ],
)
def test_what_is_wrong_for_the_gateway_is_named(old: str, new: str, message: str) -> None:
    with pytest.raises(UsageError) as refused:
        plant(PLANT.replace(old, new, 1))
    assert message in str(refused.value)
    assert str(refused.value).startswith("plant.toml: line.press.device.infeed")


def test_all_that_is_wrong_is_said_at_once_and_the_rest_understood() -> None:
    text = PLANT.replace("every = 0.5", "evry = 1").replace("address = 2", 'adress = "2"')
    found = survey(text + "[htp]\n", "plant.toml", load_profile)
    assert found.wrong == (
        "plant.toml: unknown key 'htp' - did you mean 'http'?",
        "plant.toml: line.press.device.infeed.points.speed: unknown key 'evry' - did you mean 'every'?",
        "plant.toml: line.press.device.unwinder: unknown key 'adress' - did you mean 'address'?",
        "plant.toml: line.press.device.unwinder.address is missing or not a whole number",
    )
    assert list(found.devices) == ["infeed"]
    with pytest.raises(UsageError) as refused:
        plant(text + "[htp]\n")
    assert str(refused.value) == "\n".join(found.wrong)


def test_what_the_gateway_is_told_of_a_point() -> None:
    text = PLANT.replace(
        'torque = "8238:int16"',
        'torque = { at = "8238:int16", write = { min = -5, max = 5, rate = 2 }, motion = true, '
        'role = "command", deadband = 0.5, longest = 60, fault = 0x10 }',
    ).replace("address = 0", 'address = 0\non_fault = ["status_word"]')
    infeed = plant(text).find("infeed")
    assert infeed.points["torque"] == PlantPoint(
        "torque", "8238:int16", 1.0, Limits(-5, 5, 2.0), True, Role.COMMAND, 0.5, 60.0
    )
    assert infeed.points["start"] == PlantPoint("start", "std/0x6040.0:uint16")
    assert infeed.profile.points["torque"].fault == 0x10
    assert infeed.on_fault == ("status_word",)
    assert "torque" not in infeed.known.points


def test_the_tables_of_the_gateway_are_left_to_it() -> None:
    found = plant(PLANT + "[http]\nlisten = 1\n[faults]\n")
    assert found.tables == {"http": {"listen": 1}, "faults": {}}
    assert [device.name for device in found.on("press")] == ["infeed", "unwinder"]


@pytest.mark.parametrize("place", ["0x06B", "0x6B", "0x06b", "0x006B", "drive_enable"])
def test_a_command_is_one_however_its_place_is_spelled(place: str) -> None:
    text = f'''
        [line.axis]
        port = "/dev/ttyUSB1"
        [line.axis.device.servo]
        profile = "ultra3000"
        address = 0
        [line.axis.device.servo.points]
        go = "{place}"
        '''
    servo = parse_plant(text, "x.toml", load_profile).find("servo")
    point = servo.profile.points["go"]
    assert point.role is Role.COMMAND


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


def named(profile: str, name: str, at: str) -> Plant:
    return survey(
        f'[line.a]\nport = "tcp://host:1"\n[line.a.device.d]\nprofile = "{profile}"\naddress = 3\n'
        f'[line.a.device.d.points]\n"{name}" = {{ at = "{at}", write = {{ min = 0, max = 10 }} }}\n',
        "plant.toml",
        load_profile,
    )


@pytest.mark.parametrize(
    ("profile", "name", "at"),
    [("53mc5000", "c10", "C250"), ("flexmax", "8236", "8237:int16"), ("ultra3000", "0x011", "0x012")],
)  # fmt: skip
def test_a_name_that_is_another_place_is_refused(profile: str, name: str, at: str) -> None:
    """A write to it would go there, within limits that are meant for what the plant says."""
    (wrong,) = named(profile, name, at).wrong
    assert wrong.startswith(f"plant.toml: line.a.device.d.points.{name}: ")
    assert "place of its own" in wrong


@pytest.mark.parametrize(
    ("profile", "name", "at"),
    [("53mc5000", "C250", "C250"), ("flexmax", "p44", "8237:int16"), ("ultra3000", "kp", "0x012")],
)
def test_the_plants_own_names_go_before_a_profiles(profile: str, name: str, at: str) -> None:
    plant = named(profile, name, at)
    assert plant.wrong == ()
    device = plant.devices["d"]
    there = PROTOCOLS[device.profile.protocol].device(3, device.profile, {}).point(name)
    assert there.text == at.removesuffix(":int16")
