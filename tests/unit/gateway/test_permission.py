"""What may be written over a network: only what the plant says, within its limits, not too often."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.gateway.permission import NotAllowed, Rates, allowed, check_value, number
from multidrop.gateway.polled import fault_words, polled, role_of
from multidrop.plantfile import Limits, PlantDevice, parse_plant
from multidrop.points import Role, Value

PLANT = """
[line.press]
port = "tcp://127.0.0.1:1"
[line.press.device.infeed]
profile = "flexmax"
address = 0
[line.press.device.infeed.points]
speed = { at = "actual_speed", every = 0.5 }
feed = { at = "8236:int16", write = { min = 0, max = 150, rate = 2 } }
word = { at = "std/24640.0:uint16", write = { min = 0, max = 15 } }
start = { at = "control_word", write = { min = 0, max = 15 }, motion = true }
harmless = { at = "control_word", write = { min = 0, max = 0 }, role = "setting" }
[line.axis]
port = "tcp://127.0.0.1:2"
[line.axis.device.axis]
profile = "ultra3000"
address = 1
points = { v = "motor_velocity", enable = "0x6B" }
[line.axis.device.named]
profile = "ultra3000"
address = 2
points = { word = { at = "drive_status", every = 5 } }
[line.axis.device.idle]
profile = "ultra3000"
address = 3
"""


def device(name: str = "infeed") -> PlantDevice:
    return parse_plant(PLANT, "plant.toml", load_profile).find(name)


def limits(point: str) -> Limits:
    infeed = device()
    return allowed(infeed, point, lambda: role_of(infeed, point))


def test_a_point_may_be_written_where_the_plant_says_so() -> None:
    assert limits("feed") == Limits(0, 150, 2)
    assert limits("start") == Limits(0, 15)


@pytest.mark.parametrize(
    ("point", "reason"),
    [
        ("speed", "infeed speed may not be written: the plant file has no write for it"),
        ("fed", "no point 'fed' in the plant file - did you mean 'feed'"),
        ("control_word", "no point 'control_word' in the plant file"),
        ("word", "infeed word is a command, and has no motion = true"),
    ],
)
def test_nothing_else_may(point: str, reason: str) -> None:
    with pytest.raises(NotAllowed, match=reason.replace("(", r"\(")):
        limits(point)


def test_a_command_is_one_however_it_is_spelled() -> None:
    infeed = device()
    assert [role_of(infeed, name) for name in ("word", "start", "feed", "harmless")] == [
        Role.COMMAND,
        Role.COMMAND,
        Role.UNKNOWN,
        Role.SETTING,
    ]
    assert role_of(device("axis"), "enable") is Role.COMMAND


@pytest.mark.parametrize("value", [0, 150, 12.5, True])
def test_a_number_within_the_limits(value: Value) -> None:
    check_value("infeed feed", value, Limits(0, 150))


@pytest.mark.parametrize(
    "value", [-1, 150.001, float("nan"), float("inf"), float("-inf"), "12", b"\x01"]
)
def test_no_other_value(value: Value) -> None:
    with pytest.raises(NotAllowed):
        check_value("infeed feed", value, Limits(0, 150))


def test_a_number_may_come_as_text() -> None:
    said = [number(text) for text in ("12", "0x10", "1.5", "fast", 7, "٢", "1_5")]
    assert said == [12, 16, 1.5, "fast", 7, "٢", "1_5"]
    assert isinstance(number("12"), int)


def test_two_writes_are_a_least_time_apart() -> None:
    rates = Rates()
    rates.take("infeed", "feed", 2.0, 100.0)
    with pytest.raises(NotAllowed, match=r"was written 1\.5 s ago, and may be every 2 s"):
        rates.take("infeed", "feed", 2.0, 101.5)
    rates.take("infeed", "other", 2.0, 101.5)
    rates.take("press", "feed", 2.0, 101.5)
    rates.take("infeed", "feed", 2.0, 102.0)  # one that was refused does not count


def test_fault_words_of_the_profile_are_polled_too() -> None:
    assert polled(device("axis")) == {"v": 1.0, "enable": 1.0, "drive_status": 1.0}
    assert polled(device("named")) == {"word": 5.0}
    assert polled(device("idle")) == {}
    assert fault_words(device("infeed")) == []
