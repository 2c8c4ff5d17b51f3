"""Whole numbers as people write them, and those that are too long to be any."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.naming import LineOptions, parse_device, parse_simulated
from multidrop.numerals import LONGEST, decimal_number, is_digits, whole_number
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


FOREIGN = [
    "\uff18\uff12\uff13\uff16",  # full width
    "٨٢٣٦",  # Arabic-Indic
    "८२३६",  # Devanagari
    "82३6",  # one among others
]
"""8236 and the like in digits that Python reads as numbers too."""


@pytest.mark.parametrize("text", [*FOREIGN, "1_000", "0x1_0", "0x१F", "²"])
def test_digits_of_other_scripts_and_underscores_are_no_number(text: str) -> None:
    """1_5 is a slip for 1.5, and must not become 15."""
    assert not is_digits(text)
    for read in (whole_number, decimal_number):
        with pytest.raises(ValueError, match=r"."):
            read(text)


@pytest.mark.parametrize(
    ("text", "number"), [("1.5", 1.5), ("-2e3", -2000.0), (" 7 ", 7.0), (".5", 0.5), ("007", 7.0)]
)
def test_a_decimal_number(text: str, number: float) -> None:
    assert decimal_number(text) == number


def test_digits_alone() -> None:
    assert is_digits("007")
    assert not any(map(is_digits, ("", "-1", "1.0", " 1", "0x1")))


@pytest.mark.parametrize(
    ("profile", "point"),
    [
        *[("flexmax", text) for text in FOREIGN],
        *[
            ("flexmax", text)
            for text in ("8236.१:int16", "dest२/511", "p२३६", "std/0x६041.0:uint16")
        ],
        *[("53mc5000", text) for text in ("C११३", "C103..C११5", "mem/४096/9", "mem/0x1000/९")],
        *[("ultra3000", text) for text in ("0x१6D", "१09", "0x05B.७", "kp.१", "0x05B.1_0")],
    ],
)
def test_points_in_digits_of_other_scripts(profile: str, point: str) -> None:
    found = load_profile(profile)
    with pytest.raises(
        UsageError, match=r"is not a point|has no point|is no destination|is not a range"
    ):
        PROTOCOLS[found.protocol].device(1, found, {}).points(point)


@pytest.mark.parametrize("value", ["१२", "1_2", "१.5", "0x१2"])
@pytest.mark.parametrize(
    ("profile", "point"),
    [
        ("flexmax", "8236:int16"),
        ("flexmax", "8300:float32"),
        ("flexmax", "8301:bytes"),
        ("flexmax", "8302:bool"),
        ("53mc5000", "C101"),
        ("53mc5000", "B335"),
        ("53mc5000", "mem/0x1000/1"),
        ("ultra3000", "kp"),
        ("ultra3000", "baud_rate"),
        ("ultra3000", "0x7FF"),
    ],
)
def test_values_in_digits_of_other_scripts(profile: str, point: str, value: str) -> None:
    found = load_profile(profile)
    device = PROTOCOLS[found.protocol].device(1, found, {})
    with pytest.raises(UsageError):
        device.prepare_write(point, value, force=True)


@pytest.mark.parametrize(
    ("profile", "places"),
    [
        *[("flexmax", text) for text in ("८000..9999", "8000..9९99", "dgfc/१..1023")],
        *[("53mc5000", text) for text in ("0x१600..0x0EFF", "१536")],
        ("ultra3000", "0x१00..0x7FF"),
    ],
)
def test_ranges_in_digits_of_other_scripts(profile: str, places: str) -> None:
    found = load_profile(profile)
    with pytest.raises(UsageError, match="is not a range"):
        PROTOCOLS[found.protocol].sweep(1, found, {}, places)


@pytest.mark.parametrize(
    ("protocol", "body"),
    [
        ("slink3", "२3 00"),
        ("datalink", "९1"),
        ("ultra3000", "१730"),
        ("ultra3000", "06B1\ufb00"),
    ],
)
def test_raw_commands_in_digits_of_other_scripts(protocol: str, body: str) -> None:
    """The last one is a ligature, of which Python makes FF."""
    with pytest.raises(UsageError):
        PROTOCOLS[protocol].device(1, load_profile(protocol), {}).prepare_raw(body)


def test_names_and_keys_in_digits_of_other_scripts() -> None:
    for address in (*FOREIGN, "१", "1_0", "0x१"):
        with pytest.raises(UsageError, match="is not a device"):
            parse_device(f"slink3:{address}@port")
        with pytest.raises(UsageError, match="is not a device"):
            parse_simulated(f"slink3:{address}")
    for key, text in (
        ("baud", "९600"),
        ("baud", "9_600"),
        ("timeout", "१.5"),
        ("silence", "1_0"),
    ):
        with pytest.raises(UsageError, match="is not a number"):
            LineOptions.parse({key: text}, {})
    with pytest.raises(UsageError, match="is not of the form 8E1"):
        LineOptions.parse({"format": "८E1"}, {})
    for protocol, key, text in (
        ("slink3", "broadcast", "२११"),
        ("ultra3000", "broadcast", "२११"),
        ("datalink", "settle", "१"),
        ("datalink", "settle", "1_0"),
    ):
        with pytest.raises(UsageError, match=rf"{key}="):
            PROTOCOLS[protocol].device(0, load_profile(protocol), {key: text})
