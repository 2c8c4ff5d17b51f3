"""Whole numbers as people write them, and those that are too long to be any."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.naming import LineOptions, parse_device, parse_simulated
from multidrop.numerals import LONGEST, whole_number
from multidrop.protocols import PROTOCOLS

NINES = "9" * 5000
HEX = "0x" + "F" * 5000


@pytest.mark.parametrize(
    ("text", "number"),
    [("0", 0), ("0x1F", 31), ("0X1f", 31), ("-12", -12), ("9" * LONGEST, 10**LONGEST - 1)],
)
def test_a_number(text: str, number: int) -> None:
    assert whole_number(text) == number


@pytest.mark.parametrize("text", ["", "x", "12h", "1.0", "0x"])
def test_no_number(text: str) -> None:
    with pytest.raises(ValueError, match="invalid literal"):
        whole_number(text)


def test_a_number_that_is_too_long() -> None:
    with pytest.raises(UsageError, match=r"^99999999999999999999\.\.\. is too long.*: 101 char"):
        whole_number("9" * (LONGEST + 1))


@pytest.mark.parametrize(
    ("profile", "point"),
    [
        *[
            ("flexmax", text)
            for text in (NINES, f"8236.{NINES}", f"p{NINES}", f"std/{HEX}.0:int16")
        ],
        *[("53mc5000", text) for text in (f"B{NINES}", f"mem/{HEX}/1", f"B1..B{NINES}")],
        *[("ultra3000", text) for text in (HEX, NINES, "F" * 5000, f"0x06D.{NINES}", f"kp.{HEX}")],
    ],
    ids=lambda text: text[:8],
)
def test_points_whose_number_is_too_long(profile: str, point: str) -> None:
    found = load_profile(profile)
    with pytest.raises(UsageError):
        PROTOCOLS[found.protocol].device(1, found, {}).points(point)


@pytest.mark.parametrize("value", [NINES, HEX], ids=["decimal", "hex"])
@pytest.mark.parametrize(
    ("profile", "point"),
    [
        ("flexmax", "8236:int16"),
        ("flexmax", "8300:float32"),
        ("53mc5000", "C101"),
        ("53mc5000", "B335"),
        ("ultra3000", "kp"),
        ("ultra3000", "baud_rate"),
        ("ultra3000", "0x7FF"),
    ],
)
def test_values_that_are_too_long(profile: str, point: str, value: str) -> None:
    found = load_profile(profile)
    device = PROTOCOLS[found.protocol].device(1, found, {})
    with pytest.raises(UsageError):
        device.prepare_write(point, value, force=True)


def test_names_and_keys_whose_number_is_too_long() -> None:
    with pytest.raises(UsageError):
        parse_device(f"slink3:{NINES}@port")
    with pytest.raises(UsageError):
        parse_simulated(f"slink3:{HEX}")
    with pytest.raises(UsageError):
        LineOptions.parse({"baud": NINES}, {})
    for protocol in ("slink3", "ultra3000"):
        with pytest.raises(UsageError):
            PROTOCOLS[protocol].device(0, load_profile(protocol), {"broadcast": NINES})
