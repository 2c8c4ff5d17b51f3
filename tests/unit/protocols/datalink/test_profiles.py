"""The shipped profiles of the family: every point can be said, and what the document rules holds."""

from __future__ import annotations

import re

import pytest

from multidrop.catalog import load_profile
from multidrop.points import Role
from multidrop.protocols.datalink.device import device
from multidrop.protocols.datalink.points import canonical

FAMILY = ["53mc5000", "53it5100", "53ml5100", "53sl5100", "53sl6000"]
POINTS = {name: load_profile(name).points for name in FAMILY}
EVERY = [point for points in POINTS.values() for point in points.values()]


@pytest.mark.parametrize("name", FAMILY)
def test_every_point_can_be_said_and_is_there_once(name: str) -> None:
    one = device(3, load_profile(name), {})
    places = [point.at for point in POINTS[name].values()]
    assert len(set(places)) == len(places)
    for word, description in POINTS[name].items():
        assert canonical(description.at) == description.at
        assert one.point(word) == one.point(description.at)
        assert re.fullmatch(r"[a-z][a-z0-9_]*", word)
        assert canonical(word) is None
        assert description.meaning
        assert description.source
        assert description.scale == 1.0


def test_how_many_there_are() -> None:
    assert {name: len(points) for name, points in POINTS.items()} == {
        "53mc5000": 425,
        "53it5100": 96,
        "53ml5100": 21,
        "53sl5100": 55,
        "53sl6000": 0,
    }


def test_roles() -> None:
    for point in EVERY:
        letter, number = point.at[0], int(point.at[1:])
        if letter == "H" and number < 48:  # inputs and totals
            assert (point.role, point.access) == (Role.MEASURED, "r")
        if re.search(r"(^|_)setpoint$|remote_setpoint$", point.name) and letter == "C":
            expected = Role.MEASURED if "slewed" in point.name else Role.SETPOINT
            assert point.role is expected
        if re.search(
            r"^(loop\d_)?(output|auto_switch|remote_switch)$|^total\d_reset$|^do\d$", point.name
        ):
            assert point.role is Role.COMMAND, point.name
        if point.access == "r":
            assert point.role in (Role.MEASURED, Role.IDENTITY)
        if point.at in ("B1", "B2", "L256", "L257", "L258"):
            assert point.role is Role.COMMUNICATION


@pytest.mark.parametrize("loop", [1, 2, 3])
def test_loops_follow_the_rule(loop: int) -> None:
    points = POINTS["53mc5000"]
    steps = {"C": 36, "L": 24, "B": 5}
    names = [name for name in points if name.startswith("loop0_")]
    assert len(names) == 46
    for name in names:
        first, other = points[name], points[name.replace("loop0", f"loop{loop}", 1)]
        letter, number = first.at[0], int(first.at[1:])
        assert other.at == f"{letter}{number + steps[letter] * loop}"
        assert (other.role, other.access, other.unit) == (first.role, first.access, first.unit)


def test_derived_points_are_marked() -> None:
    derived = {point.at for point in EVERY if point.derived}
    assert {"C138", "C139", "L105", "L136", "L186", "B340"} <= derived
    assert not {"C174", "C210", "L160", "L107", "L112", "C100", "L139"} & derived
    assert {point.source for point in EVERY if point.derived} == {"rule: +36 C, +24 L, +5 B a loop"}


def test_what_sources_contradict_each_other_about() -> None:
    assert POINTS["53mc5000"]["loop0_reverse"].default == 1
    assert POINTS["53sl5100"]["reverse"].default == 0
    assert POINTS["53mc5000"]["ai0_span"].default is None  # printed as 100/0


def test_program_wiring_is_left_out() -> None:
    wiring = [*range(148, 152), *range(187, 191), *range(201, 205), *range(212, 237)]
    assert not {f"B{number}" for number in wiring} & {point.at for point in EVERY}


def test_a_point_by_name_from_end_to_end() -> None:
    one = device(3, load_profile("53mc5000"), {})
    found = one.point("loop2_setpoint")
    assert (found.text, found.memory_address, found.unit) == ("C173", 0x600 + 3 * 173, "EU")
    assert found.role is Role.SETPOINT
    assert one.prepare_write("loop0_auto_switch", "automatic").value == "automatic"
