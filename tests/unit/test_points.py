"""Points and how values are shown."""

from __future__ import annotations

from datetime import UTC, datetime

from multidrop.points import Point, Reading, Role, Sample, shown_value
from multidrop.profile import PointDescription


def test_a_point_without_a_description() -> None:
    point = Point("8236")
    assert (point.name, point.unit, point.role) == (None, None, Role.UNKNOWN)
    assert str(point) == "8236"


def test_a_point_with_a_description() -> None:
    point = Point(
        "8236", "int16", PointDescription("speed", "8236:int16", Role.SETTING, unit="rpm")
    )
    assert (point.name, point.unit, point.role) == ("speed", "rpm", Role.SETTING)
    assert str(point) == "speed (8236)"


def test_a_point_scales_as_its_description_does() -> None:
    scaled = PointDescription("speed", "8236:int16", scale=0.1)
    assert Point("8236", "int16", scaled).physical(123) == 12.3
    assert Point("8236").physical(123) == 123


def test_values_for_a_message() -> None:
    assert shown_value(b"\xc8\x00") == "C8 00"
    assert shown_value(-1.5) == "-1.5"
    assert shown_value("text") == "text"


def test_a_point_is_of_the_device_itself() -> None:
    assert Point("8236").within == ""


def test_a_word_says_a_fault_by_its_bits() -> None:
    word = PointDescription("word", "0x073", fault=0x1600)
    assert [word.says_fault(raw) for raw in (0x0200, 0x1001, 0x8100, 0)] == [
        True,
        True,
        False,
        False,
    ]
    assert PointDescription("alarm", "L110", fault=1).says_fault(True) is True
    assert [word.says_fault(raw) for raw in ("text", b"\x02", 2.0)] == [None, None, None]
    assert PointDescription("speed", "8236").says_fault(0x0200) is None


def test_bytes_are_shown_in_hex() -> None:
    assert Point("8236").raw_text(b"\x7d\x00") == "7d00"


TIME = datetime(2026, 11, 22, 12, 0, tzinfo=UTC)


def test_a_reading_of_a_point_that_nobody_describes() -> None:
    assert Point("8236").reading(Sample(5, "int16", b"\5\0"), TIME, 1.5) == Reading(
        point="8236",
        name=None,
        value=5,
        unit=None,
        type="int16",
        raw=b"\5\0",
        fault=None,
        time=TIME,
        ms=1.5,
        raw_text="0500",
        meaning=None,
    )


def test_a_reading_of_a_point_that_the_profile_describes() -> None:
    known = PointDescription("mode", "8236:int16", unit="rpm", scale=0.1, names={"5": "fast"})
    sample = Sample(5, "int16", b"\5\0", fault=True)
    assert Point("8236", "int16", known).reading(sample, TIME, 1.5) == Reading(
        point="8236",
        name="mode",
        value=0.5,
        unit="rpm",
        type="int16",
        raw=b"\5\0",
        fault=True,
        time=TIME,
        ms=1.5,
        raw_text="0500",
        meaning="fast",
    )
