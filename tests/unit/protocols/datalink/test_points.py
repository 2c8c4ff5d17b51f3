"""How points are written: grammar, ranges, names, and what is refused."""

from __future__ import annotations

import pytest

from multidrop.errors import UsageError
from multidrop.points import Role
from multidrop.profile import PointDescription, Profile
from multidrop.protocols.datalink.memory import MAP_A, MAP_B
from multidrop.protocols.datalink.points import DataPoint, Points, canonical

PROFILE = Profile(
    "53test",
    "datalink",
    points={
        "limit": PointDescription("limit", "C103", Role.SETTING, unit="EU", scale=0.1),
        "again": PointDescription("again", "c0103"),
        "switch": PointDescription("switch", "L112"),
        "block": PointDescription("block", "mem/0x1000/9"),
        "count": PointDescription("count", "B5", scale=0.1),
    },
)
POINTS = Points(PROFILE, MAP_A)


def point(text: str) -> DataPoint:
    (found,) = POINTS.find(text)
    return found


@pytest.mark.parametrize(
    ("text", "canonical_text", "address", "count", "bit", "type_name"),
    [
        ("B12", "B12", 0x20C, 1, 0, "uint8"),
        ("L14", "L14", 0x501, 1, 6, "bool"),
        ("C103", "C103", 0x735, 3, 0, "real3"),
        ("c0103", "C103", 0x735, 3, 0, "real3"),
        (" H000 ", "H0", 0xF00, 5, 0, "real5"),
        ("A8", "A8", 0x1450, 10, 0, "string"),
        ("F3", "F3", 0x140F, 5, 0, "string"),
        ("mem/0x1000/9", "mem/0x1000/9", 0x1000, 9, 0, "bytes"),
        ("mem/4096/0x9", "mem/0x1000/9", 0x1000, 9, 0, "bytes"),
        ("mem/0xffff/1", "mem/0xFFFF/1", 0xFFFF, 1, 0, "bytes"),
    ],
)
def test_the_grammar(
    text: str, canonical_text: str, address: int, count: int, bit: int, type_name: str
) -> None:
    found = point(text)
    assert found.text == canonical_text
    assert (found.memory_address, found.count, found.bit) == (address, count, bit)
    assert found.type == type_name
    assert found.mapped is not text.startswith("mem")


def test_names_and_what_the_profile_says() -> None:
    assert point("limit").text == "C103"
    assert point("limit").unit == "EU"
    assert point("again").name == "again"
    assert point("C103").name == "limit"  # the first one that names it
    assert point("C104").name is None
    assert point("block").text == "mem/0x1000/9"
    assert POINTS.has("L112")
    assert not POINTS.has("L113")


def test_ranges() -> None:
    assert [one.text for one in POINTS.find("C102..C104")] == ["C102", "C103", "C104"]
    assert [one.name for one in POINTS.find("c103..c0103")] == ["limit"]
    assert len(POINTS.find("L0..L2047")) == 2048


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "'' is not a point: B12, L14, C103"),
        ("X5", "53test has no point 'X5'; a point is B12"),
        ("limt", "53test has no point 'limt' - did you mean 'limit'?"),
        ("C", "53test has no point 'C'"),
        ("C1x", "53test has no point 'C1x'"),
        ("C-1", "53test has no point 'C-1'"),
        ("12", "'12' is not a point"),
        ("C103:real3", "'C103:real3' is not a point"),
        ("mem/0x1000", "'mem/0x1000' is not a point"),
        ("mem/0x1000/", "is not a point"),
        ("mem/x/1", "is not a point"),
        ("mem/0x1000/0", "0 bytes of memory cannot be read"),
        ("mem/0xFFFF/2", "2 bytes from FFFFh on are not in memory"),
        ("mem/99999999/1", "are not in memory"),
        ("C768", r"C768: map A has C0\.\.C767"),
        ("C0..C999999", r"C768: map A has C0\.\.C767"),
        ("C103..L105", "is not a range of one type"),
        ("C103..", "is not a range"),
        ("..C103", "is not a range"),
        ("limit..C105", "is not a range"),
        ("mem/0/1..mem/1/1", "is not a range"),
        ("C105..C103", "'C105..C103' runs backwards"),
        ("C" + "9" * 5000, "has no point"),
    ],
)
def test_what_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        POINTS.find(text)


def test_a_point_that_the_map_cannot_place() -> None:
    with pytest.raises(UsageError, match="C103: where map B keeps its C points is in no source"):
        Points(PROFILE, MAP_B).find("limit")


def test_a_profile_with_something_else_in_at() -> None:
    wrong = Profile("x", "datalink", points={"p": PointDescription("p", "8236:int16")})
    with pytest.raises(UsageError, match="point p: at = '8236:int16' is not B12"):
        Points(wrong, MAP_A)


def test_canonical() -> None:
    assert canonical("l007") == "L7"
    assert canonical("mem/16/1") == "mem/0x0010/1"
    assert canonical("speed") is None


def test_samples() -> None:
    assert point("C103").sample(bytes.fromhex("64 00 07 FF")).value == 100.0
    assert point("C103").sample(bytes.fromhex("64 00 07 FF")).raw == bytes.fromhex("64 00 07")
    assert point("L14").sample(b"\x40").value is True
    assert point("L14").sample(b"\xbf").value is False
    assert point("L14").sample(b"\x40").raw == b"\x01"
    assert point("L14").sample(b"\x40").type == "bool"
    assert point("L14").sample(b"\x40").fault is None


def test_the_profiles_scale() -> None:
    assert point("C104").unscaled(12.34) == 12.34
    assert point("limit").unscaled(12.34) == pytest.approx(123.4)  # a real keeps its digits
    assert point("count").unscaled(12.34) == 123  # a byte is whole
    assert point("block").unscaled(b"123456789") == b"123456789"
