"""How points are written, for each dialect, and what is refused before anything is sent."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.points import Role
from multidrop.profile import PointDescription, Profile
from multidrop.protocols.slink3 import AX_V, DGFC386, FLEXMAX, SLINK3, Dialect, Format
from multidrop.protocols.slink3.dialects import DIALECTS
from multidrop.protocols.slink3.points import ParameterPoint, parse_point

EMPTY = Profile("slink3", "slink3")


def fields(point: ParameterPoint) -> tuple[Any, ...]:
    return point.index, point.subindex, point.destination, point.standard, point.type_code


@pytest.mark.parametrize(
    ("dialect", "text", "expected", "shown"),
    [
        (SLINK3, "8236", (8236, None, 0, False, None), "8236"),
        (SLINK3, " 8236:int16 ", (8236, None, 0, False, Format.SHORT_INT), "8236"),
        (SLINK3, "0x202C:INT16", (8236, None, 0, False, Format.SHORT_INT), "8236"),
        (SLINK3, "08236", (8236, None, 0, False, None), "8236"),
        (SLINK3, "8236.1:float32", (8236, 1, 0, False, Format.FLOAT), "8236.1"),
        (SLINK3, "8236.0xFF", (8236, 255, 0, False, None), "8236.255"),
        (SLINK3, "0", (0, None, 0, False, None), "0"),
        (SLINK3, "65535", (65535, None, 0, False, None), "65535"),
        (SLINK3, "dgfc/511:uint8", (511, None, 2, False, Format.UNSIGNED_CHAR), "dgfc/511"),
        (FLEXMAX, "DEST2/511", (511, None, 2, False, None), "dgfc/511"),
        (
            DGFC386,
            "drive/8511:uint16",
            (8511, None, 2, False, Format.UNSIGNED_SHORT_INT),
            "drive/8511",
        ),
        (SLINK3, "dest7/1.2:bytes", (1, 2, 7, False, Format.OCTET_STRING), "dest7/1.2"),
        (AX_V, "dest2/1:int8", (1, None, 2, False, Format.CHAR), "dest2/1"),
        (
            SLINK3,
            "std/0x6041.0:uint16",
            (0x6041, 0, 0, True, Format.UNSIGNED_SHORT_INT),
            "std/0x6041.0",
        ),
        (
            FLEXMAX,
            "STD/24641:uint16",
            (0x6041, 0, 0, True, Format.UNSIGNED_SHORT_INT),
            "std/0x6041.0",
        ),
        (FLEXMAX, "8236:auto", (8236, None, 0, False, Format.VOID), "8236"),
    ],
)
def test_points(dialect: Dialect, text: str, expected: tuple[Any, ...], shown: str) -> None:
    point = parse_point(text, EMPTY, dialect)
    assert fields(point) == expected
    assert point.text == shown
    assert point.type == (None if point.type_code is None else point.type_code.type_name)


@pytest.mark.parametrize(
    ("dialect", "text", "message"),
    [
        (SLINK3, "", r"'' is not a point: \[DEST/\]INDEX"),
        (SLINK3, "8236:", "is not a point"),
        (SLINK3, "-1", "is not a point"),
        (SLINK3, "0xG", "is not a point"),
        (SLINK3, "65536", "index 65536 of '65536' is out of range"),
        (SLINK3, "1.256", "subindex 256 of '1.256' is out of range"),
        (SLINK3, "8236:int17", "'int17' is no type - did you mean 'int16'?"),
        (SLINK3, "8236:x", "'x' is no type; types are auto bool"),
        (FLEXMAX, "8236:int8", "flexmax has no type int8; it has float32 int16"),
        (FLEXMAX, "dgfc/511:string", "dgfc386 has no type string"),
        (DGFC386, "drive/1:bool", "flexmax has no type bool"),
        (AX_V, "1009.1", "ax-v has no subindex"),
        (AX_V, "dgfc/1", "'dgfc' is no destination of ax-v: dest1..dest7$"),
        (FLEXMAX, "drive/1", "'drive' is no destination of flexmax: dest1..dest7, dgfc"),
        (DGFC386, "dgfc/1", "'dgfc' is no destination of dgfc386: dest1..dest7, drive"),
        (SLINK3, "dest8/1", "'dest8' is no destination of slink3"),
        (SLINK3, "dest0/1", "'dest0' is no destination of slink3"),
        (AX_V, "std/0x6041.0:uint16", "ax-v has no standard parameters"),
        (DGFC386, "std/0x6041.0:uint16", "dgfc386 has no standard parameters"),
        (FLEXMAX, "std/0x6041.0", "needs a type: a Drivecom parameter does not carry one"),
        (FLEXMAX, "std/0x6041.0:auto", "needs a type"),
        (SLINK3, "speed", "slink3 has no point 'speed'; a point is"),
    ],
)
def test_no_points(dialect: Dialect, text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message.replace("?", r"\?")):
        parse_point(text, EMPTY, dialect)


def described(**points: PointDescription) -> Profile:
    return replace(EMPTY, name="press", inferred={"p": 8192}, points=points)


SPEED = PointDescription("speed", "8237:int16", Role.SETPOINT)
CARD = PointDescription("card", "dgfc/511:uint8")
WORD = PointDescription("word", "std/0x6042.0:uint16")


@pytest.mark.parametrize("text", ["speed", "8237", "0x202D", "speed:int16"])
def test_a_point_of_the_profile_by_name_or_by_number(text: str) -> None:
    point = parse_point(text, described(speed=SPEED), FLEXMAX)
    assert fields(point) == (8237, None, 0, False, Format.SHORT_INT)
    assert (point.name, point.role, point.type) == ("speed", Role.SETPOINT, "int16")


def test_a_type_that_is_named_wins_over_the_profiles() -> None:
    profile = described(speed=SPEED, word=WORD)
    assert parse_point("speed:uint16", profile, FLEXMAX).type == "uint16"
    assert parse_point("8237:uint16", profile, FLEXMAX).type == "uint16"
    assert parse_point("8237:auto", profile, FLEXMAX).type == "auto"
    assert parse_point("word:int16", profile, FLEXMAX).type == "int16"


@pytest.mark.parametrize("text", ["word", "word:auto", "std/0x6042.0", "std/0x6042:auto"])
def test_a_standard_point_of_the_profile_has_its_type(text: str) -> None:
    assert parse_point(text, described(word=WORD), FLEXMAX).type == "uint16"


def test_a_named_point_has_the_types_of_where_it_leads() -> None:
    assert parse_point("card:int8", described(card=CARD), FLEXMAX).type == "int8"
    with pytest.raises(UsageError, match="dgfc386 has no type string"):
        parse_point("card:string", described(card=CARD), FLEXMAX)


def test_another_subindex_is_another_point() -> None:
    assert parse_point("8237.1", described(speed=SPEED), FLEXMAX).description is None


def test_an_inferred_name() -> None:
    profile = described(speed=SPEED)
    point = parse_point("p44:int16", profile, FLEXMAX)
    assert fields(point) == (8236, None, 0, False, Format.SHORT_INT)
    assert point.inferred
    assert parse_point("p45", profile, FLEXMAX).name == "speed"
    assert parse_point("p45", profile, FLEXMAX).inferred
    assert not parse_point("8236", profile, FLEXMAX).inferred
    with pytest.raises(UsageError, match=r"index 70192 of 'p62000' is out of range"):
        parse_point("p62000", profile, FLEXMAX)


@pytest.mark.parametrize("text", ["p", "px", "q44", "sped"])
def test_no_inferred_name(text: str) -> None:
    with pytest.raises(UsageError, match=f"press has no point '{text}'"):
        parse_point(text, described(speed=SPEED), FLEXMAX)


def test_the_nearest_name_is_offered() -> None:
    with pytest.raises(UsageError, match="did you mean 'speed'"):
        parse_point("sped", described(speed=SPEED), FLEXMAX)


@pytest.mark.parametrize("at", ["somewhere", "8237:int16 rpm"])
def test_a_profile_that_cannot_be_understood(at: str) -> None:
    wrong = PointDescription("speed", at)
    with pytest.raises(UsageError, match=f"point speed: at = '{at}' is not"):
        parse_point("8236", described(speed=wrong), FLEXMAX)


@pytest.mark.parametrize("text", ["std/0x6040.0:uint16", "std/0x6040.0", "std/24640"])
def test_the_control_word_is_a_command_in_every_profile(text: str) -> None:
    point = parse_point(text, EMPTY, SLINK3)
    assert (point.role, point.type) == (Role.COMMAND, "uint16")


@pytest.mark.parametrize("name", DIALECTS)
def test_every_point_of_the_shipped_profiles_can_be_said(name: str) -> None:
    profile = load_profile(name)
    dialect = DIALECTS[profile.dialect or name]
    for point_name, description in profile.points.items():
        point = parse_point(point_name, profile, dialect)
        assert point.type is not None
        assert parse_point(description.at, profile, dialect) == point


def test_who_answers_behind_a_destination() -> None:
    assert parse_point("dgfc/511", EMPTY, FLEXMAX).within == "dest2"
    assert parse_point("8236", EMPTY, FLEXMAX).within == ""
