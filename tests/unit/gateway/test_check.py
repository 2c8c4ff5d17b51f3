"""What is wrong with a plant before anything is opened."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.gateway.check import Checked, check, demand_right
from multidrop.plantfile import survey
from multidrop.protocols import slink3

PLANT = """
[line.press]
port = "/dev/ttyUSB0"
[line.press.device.infeed]
profile = "flexmax"
address = 0
on_fault = ["status_word"]
[line.press.device.infeed.points]
speed = { at = "actual_speed", every = 0.5 }
feed = { at = "8236:int16", scale = 0.1, write = { min = 0, max = 150 } }
start = { at = "control_word", write = { min = 0, max = 15 }, motion = true }
[line.press.device.unwinder]
profile = "ax-v"
address = 2
points = { tension = "1009:int16" }
[line.axis]
port = "tcp://10.0.0.7:4001"
[line.axis.device.axis]
profile = "ultra3000"
address = 1
points = { v = "motor_velocity" }
"""


def checked(text: str = PLANT) -> Checked:
    return check(survey(text, "plant.toml", load_profile))


def test_a_plant_that_can_be_run() -> None:
    found = checked()
    assert found.wrong == ()
    press, axis = found.lines
    assert (press.name, press.port, press.settings) == ("press", "/dev/ttyUSB0", "slink3 9600 8E1")
    assert (press.devices, press.points) == (2, 4)
    # five times a second: 11 + 13 characters of 11 bits, 10 ms of delay, and the gap
    assert press.load == pytest.approx(5 * (24 * 11 / 9600 + 0.010 + slink3.LINE.gap))
    assert (axis.settings, axis.points) == ("ultra3000 38400 8N1", 2)  # its fault word too
    assert demand_right(survey(PLANT, "plant.toml", load_profile)) == found


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("every = 0.5", "every = 0.04", "line.press: its polls take 11"),
        ('profile = "ax-v"', 'profile = "ultra3000"', "slink3 9600 8E1, unwinder ultra3000 38400"),
        ("address = 2", "address = 255", "line.press.device.unwinder: address 255 is out of range"),
        (
            "address = 1\n",
            'address = 1\n[line.x]\nport = "x"\n',
            "line.x has no devices",
        ),
        ('"tcp://10.0.0.7:4001"', '"tcp://10.0.0.7:4001"\nbroadcast = 1', "the broadcast address"),
        ('"actual_speed"', '"actual_sped"', "points.speed: point speed: at = 'actual_sped' is not"),
        ('["status_word"]', '["nothing"]', "infeed.on_fault: flexmax has no point 'nothing'"),
        ("max = 150 ", "max = 4000 ", "points.feed: 40000 does not fit int16: -32768..32767"),
        ('"8236:int16"', '"8236"', "points.feed.write: a point that is written needs its type"),
        (", motion = true", "", "points.start.write: it is a command, which may move something"),
        ("every = 0.5", "motion = true", "points.speed.motion allows nothing: there is no write"),
        (
            '"actual_speed", every = 0.5',
            '"status_word", write = { min = 0, max = 1 }',
            "points.speed: speed (std/0x6041.0) is read-only",
        ),
        ("every = 0.5", "every = 100000", "every 100000 s is out of range: 0.001..86400 s"),
        ('"tcp://10.0.0.7:4001"', '"x"\nbauds = 1', "line.axis: unknown key 'bauds' - did you"),
        ('"tcp://10.0.0.7:4001"', '"/dev/../dev/ttyUSB0"', "is the port of line press"),
        ("[line.axis]", "[http]\nlistn = 1\n[line.axis]", "http: unknown key 'listn'"),
    ],
)
def test_what_is_wrong_is_found(old: str, new: str, wrong: str) -> None:
    assert old in PLANT
    (said,) = checked(PLANT.replace(old, new, 1)).wrong
    assert said.startswith("plant.toml: ")
    assert wrong in said


def test_a_link_and_the_device_it_leads_to_are_one_port(tmp_path: Path) -> None:
    os.symlink("/dev/ttyUSB0", tmp_path / "adapter")
    (said,) = checked(PLANT.replace("tcp://10.0.0.7:4001", f"{tmp_path}/adapter")).wrong
    assert "is the port of line press, '/dev/ttyUSB0'" in said


def test_hosts_are_one_however_they_are_written() -> None:
    text = PLANT.replace("/dev/ttyUSB0", "tcp://GW:1").replace("tcp://10.0.0.7:4001", "tcp://gw:1")
    assert "is the port of line press" in checked(text).wrong[0]


def test_all_findings_come_at_once() -> None:
    text = (
        PLANT.replace("every = 0.5", "every = 0.04")
        .replace("max = 150 ", "max = 4000 ")
        .replace("address = 1\n", "address = 300\n")
        .replace('["status_word"]', '["nothing"]')
        + "[faults]\nkeep = 0\n[spam]\n"
    )
    found = checked(text)
    assert len(found.wrong) == 6
    with pytest.raises(UsageError) as refused:
        demand_right(survey(text, "plant.toml", load_profile))
    assert str(refused.value) == "\n".join(found.wrong)


def test_a_file_without_lines() -> None:
    assert checked("").wrong == ("plant.toml has no lines",)
