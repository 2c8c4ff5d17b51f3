"""Memory maps A and B, the plan of messages, and the bytes that a change touches."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from multidrop.errors import UsageError
from multidrop.profile import Profile
from multidrop.protocols.datalink.memory import MAP_A, MAP_B, MAPS, pieces, plan, span
from multidrop.protocols.datalink.points import Points


@pytest.mark.parametrize(
    ("letter", "number", "address"),
    [
        ("B", 0, 0x200),
        ("B", 767, 0x4FF),
        ("L", 0, 0x500),
        ("L", 7, 0x500),
        ("L", 14, 0x501),
        ("L", 2047, 0x5FF),
        ("C", 103, 0x735),
        ("C", 767, 0xEFD),
        ("H", 0, 0xF00),
        ("H", 127, 0x117B),
        ("A", 8, 0x1450),
        ("A", 319, 0x2076),
        ("F", 3, 0x140F),
        ("F", 639, 0x207B),
    ],
)
def test_map_a(letter: str, number: int, address: int) -> None:
    assert MAP_A.locate(letter, number) == address


@pytest.mark.parametrize(
    ("letter", "number", "last"),
    [
        ("B", 768, "B767"),
        ("L", 2048, "L2047"),
        ("C", 768, "C767"),
        ("H", 128, "H127"),
        ("A", 320, "A319"),
        ("F", 640, "F639"),
    ],
)
def test_map_a_ends(letter: str, number: int, last: str) -> None:
    with pytest.raises(UsageError, match=rf"{letter}{number}: map A has {letter}0\.\.{last}"):
        MAP_A.locate(letter, number)


@pytest.mark.parametrize(
    ("letter", "number", "address"),
    [("H", 0, 0x9CF), ("H", 4, 0x9E3), ("A", 0, 0x9E8), ("A", 2, 0x9FC), ("F", 1, 0x9ED)],
)
def test_map_b(letter: str, number: int, address: int) -> None:
    assert MAP_B.locate(letter, number) == address


@pytest.mark.parametrize("letter", ["B", "L", "C"])
def test_map_b_does_not_say_where_these_are(letter: str) -> None:
    with pytest.raises(UsageError, match=f"where map B keeps its {letter} points is in no source"):
        MAP_B.locate(letter, 0)


def test_the_end_of_memory() -> None:
    last = (0x10000 - 0x9E8) // 10 - 1
    assert MAP_B.locate("A", last) + 10 <= 0x10000
    with pytest.raises(UsageError, match="behind the end of memory"):
        MAP_B.locate("A", last + 1)


def test_a_profile_may_say_where_they_are() -> None:
    known = MAP_B.with_bases({"C": 0x600, "H": 0xF00})
    assert known.locate("C", 103) == 0x735
    assert known.locate("H", 100) == 0xF00 + 500
    assert known.locate("A", 0) == 0x9E8
    assert MAP_B.with_bases({}) == MAP_B


@pytest.mark.parametrize("bases", [{"X": 0x600}, {"C": -1}, {"C": 0x10000}, {"c": 0}])
def test_no_such_base(bases: dict[str, int]) -> None:
    with pytest.raises(UsageError, match="is not a type B L C H A F at"):
        MAP_B.with_bases(bases)


def test_maps_by_the_dialect_of_a_profile() -> None:
    assert MAPS == {"map-a": MAP_A, "map-b": MAP_B}
    assert MAP_A.identifier == 6
    assert MAP_B.identifier is None


POINTS = Points(Profile("datalink", "datalink"), MAP_A)


def groups(*texts: str) -> list[str]:
    """The plan of these points, each message as its points' names."""
    points = [point for text in texts for point in POINTS.find(text)]
    return [" ".join(point.text for point in group) for group in plan(points)]


@pytest.mark.parametrize(
    ("text", "messages"),
    [
        ("C100..C109", 1),
        ("C100..C110", 2),
        ("C100..C199", 10),
        ("H0..H5", 1),
        ("H0..H6", 2),
        ("A0..A2", 1),
        ("A0..A3", 2),
        ("B0..B31", 1),
        ("B0..B32", 2),
        ("L0..L255", 1),
        ("L0..L256", 2),
        ("L1..L256", 2),
        ("mem/0x1000/100", 1),
    ],
)
def test_how_many_messages(text: str, messages: int) -> None:
    assert len(groups(text)) == messages


def test_neighbours_share_a_message_whatever_their_order_and_type() -> None:
    assert groups("C103", "B5", "C101", "C100") == ["B5", "C100 C101 C103"]
    assert groups("L104", "L195") == ["L104 L195"]
    assert groups("B767", "L0") == ["B767 L0"]  # neighbours across the end of a type
    assert groups("A54", "F108") == ["A54 F108"]  # one laid over the other
    assert groups("C100", "C200") == ["C100", "C200"]
    assert groups() == []


def test_a_value_is_never_cut_in_two() -> None:
    found = plan(POINTS.find("C100..C130"))
    assert [span(group) for group in found] == [(0x72C + 30 * n, 30) for n in range(3)] + [
        (0x72C + 90, 3)
    ]


@dataclass(frozen=True)
class Piece:
    memory_address: int
    count: int


def test_the_span_of_a_group() -> None:
    assert span([Piece(10, 5), Piece(12, 1)]) == (10, 5)
    assert span([Piece(12, 8), Piece(10, 1)]) == (10, 10)


def test_pieces_of_32_bytes() -> None:
    assert pieces(0x1000, 1) == [(0x1000, 1)]
    assert pieces(0x1000, 32) == [(0x1000, 32)]
    assert pieces(0x1000, 70) == [(0x1000, 32), (0x1020, 32), (0x1040, 6)]
    assert pieces(0xFFFF, 1) == [(0xFFFF, 1)]


@pytest.mark.parametrize(("at", "count"), [(0, 0), (0, -1), (-1, 2), (0xFFFF, 2), (0x10000, 1)])
def test_what_is_not_in_memory(at: int, count: int) -> None:
    with pytest.raises(UsageError, match="bytes"):
        pieces(at, count)
