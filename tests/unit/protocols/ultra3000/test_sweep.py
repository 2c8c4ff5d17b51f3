"""Which parameters a drive has, with their types, limits, defaults and elements."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from probing import ran

from multidrop.catalog import load_profile
from multidrop.conversation import Learn
from multidrop.errors import UsageError
from multidrop.points import PointDescription, Sample
from multidrop.profile import Profile
from multidrop.protocols.ultra3000 import Frame
from multidrop.protocols.ultra3000.sweep import Ultra3000Sweep, sweep

BARE = Profile("bare", "ultra3000")
Known = dict[tuple[int, int], str]
"""Parameter and function -> digits; two with an exclamation mark are a refusal."""


def answers(known: Known) -> Any:
    def answer(question: Frame) -> Frame:
        found = known.get((question.parameter, question.function), "!08")
        if found == "indexed":
            found = f"{question.data}0123" if question.data else "!07"
        if found.startswith("!"):
            return question._replace(parameter=question.parameter + 0x800, data=found[1:])
        return question._replace(data=found)

    return answer


def found(known: Known, place: int = 0x11, profile: Profile = BARE) -> list[PointDescription]:
    discovered, _ = ran(of(profile).look(place), answers(known))
    return [item.description for item in discovered]


def of(profile: Profile, text: str | None = None) -> Ultra3000Sweep:
    return sweep(9, profile, {}, text)


def test_nothing_there_costs_one_read() -> None:
    discovered, asked = ran(of(BARE).look(0x11), answers({}))
    assert (discovered, asked) == ([], [Frame(9, 0x011)])


def test_type_limits_and_default() -> None:
    known = {(0x11, 0): "0200", (0x11, 6): "0100", (0x11, 8): "0000", (0x11, 9): "0FFF"}
    (point,) = found(known)
    assert point == PointDescription(
        "parameter_011", "0x011", type="uint16", minimum=0, maximum=4095, default=256,
        source="discovered", note="it held 512",
    )  # fmt: skip


def test_a_minimum_above_the_maximum_has_a_sign() -> None:
    (point,) = found({(0x11, 0): "FFFF", (0x11, 8): "8001", (0x11, 9): "7FFF"})
    assert (point.type, point.minimum, point.maximum) == ("int16", -32767, 32767)
    assert point.note == "it held -1"


def test_a_value_without_limits_has_an_unknown_sign() -> None:
    (point,) = found({(0x11, 0): "FF", (0x11, 9): "0001"})
    assert (point.type, point.maximum, point.note) == (
        "uint8",
        None,
        "it held 255; its sign is not known",
    )


@pytest.mark.parametrize(("digits", "note"), [("414200000000", "it held AB"), ("000000000000", "")])
def test_many_digits_are_text(digits: str, note: str) -> None:
    (point,) = found({(0x06, 0): digits, (0x06, 6): "204243" * 2, (0x06, 9): "204243" * 2}, 0x06)
    assert (point.type, point.length, point.note) == ("string", 6, note)
    assert (point.default, point.maximum) == (" BC BC", None)
    (blank,) = found({(0x06, 0): digits, (0x06, 6): "0" * 12}, 0x06)
    assert blank.default is None


def test_digits_of_no_type_are_shown_as_they_are() -> None:
    (point,) = found({(0x11, 0): "123"})
    assert (point.type, point.note) == (None, "it held 0x123")


def test_an_array_by_its_refusal_and_its_bounds() -> None:
    known = {(0x5B, 0): "indexed", (0x5B, 9): "indexed", (0x5B, 0xA): "00", (0x5B, 0xB): "07"}
    discovered, asked = ran(of(BARE).look(0x5B), answers(known))
    (point,) = (item.description for item in discovered)
    assert (point.type, point.elements, point.maximum) == ("uint16", 8, 0x123)
    assert {frame.function for frame in asked} == {0, 6, 8, 9, 0xA, 0xB}
    assert {frame.data for frame in asked} == {"", "00"}


def test_an_array_that_answers_without_an_index() -> None:
    (point,) = found({(0x5B, 0): "12345678", (0x5B, 0xB): "03"}, 0x5B)
    assert (point.type, point.elements) == ("uint32", 4)


@pytest.mark.parametrize("known", [{(0x5B, 0): "!07"}, {(0x5B, 0): "indexed"}])
def test_an_array_without_an_element(known: Known) -> None:
    (point,) = found(known, 0x5B)
    assert point.note == "there, and not read: an array without an element"


def test_another_refusal_shows_that_it_is_there() -> None:
    (point,) = found({(0x11, 0): "!02"})
    assert point.note.startswith("there, and not read: refused with code 0002h")


def test_what_the_profile_knows() -> None:
    profile = load_profile("ultra3000")
    one = {(0x11, 0): "0200"}
    assert found(one, profile=profile) == [profile.points["kp"]]
    assert found({}, profile=profile) == []
    assert found({(0x11, 0): "!02"}, profile=profile) == [profile.points["kp"]]
    array = {(0x5B, 0): "0012345678"}
    assert found(array, 0x5B, profile) == [profile.points["preset_velocity"]]
    _, asked = ran(of(profile).look(0x5B), answers(array))
    assert asked[-1] == Frame(9, 0x05B, 0, "00")
    discovered, asked = ran(of(profile).look(0x04), answers({}))
    assert [item.description.name for item in discovered] == ["factory_reset"]
    assert asked == [], "an action cannot be read"


def test_the_line_is_asked_whether_it_hears_itself_before_an_index_is_sent() -> None:
    conversation = of(BARE).look(0x5B)
    step = next(conversation)
    refusal = Frame(9, 0x85B, 0, "07")
    seen = []
    for answer in (refusal, Frame(9, 0x5B, 0xB, "07"), Frame(9, 0x5B, 0xA, "00"), None):
        step = conversation.send(answer)  # type: ignore[arg-type]
        seen.append(isinstance(step, Learn))
    assert seen == [False, False, True, False]


def test_ranges_and_what_they_cover() -> None:
    profile = load_profile("ultra3000")
    assert of(BARE).places == range(0x800)
    some = of(profile, "0x010..0x012")
    assert (some.places, some.where(0x11)) == (range(0x10, 0x13), "0x011")
    assert of(BARE, "0x7ff").places == range(0x7FF, 0x800)
    assert [name for name, item in profile.points.items() if some.covers(item)] == ["kp", "ki"]
    assert ran(some.begin(), lambda frame: frame) == (None, [])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0..100", "is not a range of parameters: 0xFIRST..0xLAST"),
        ("0x000..0x800", "parameter 0x800 is out of range"),
        ("0x011..0x010", "runs backwards"),
    ],
)
def test_what_is_no_range(text: str, said: str) -> None:
    with pytest.raises(UsageError) as raised:
        of(BARE, text)
    assert said in str(raised.value)


def test_what_others_were_heard_to_read() -> None:
    profile = load_profile("ultra3000")
    swept = of(profile)
    point = swept._known[0x11][0]
    sample = Sample("0x0200", "hex", b"0200")
    assert swept.heard(point, sample) == profile.points["kp"]
    bare = replace(point, description=None)
    assert (swept.heard(bare, sample).at, swept.heard(bare, sample).type) == ("0x011", "uint16")
    element = swept.heard(bare.of(bare.view, 3), sample)
    assert (element.at, element.elements) == ("0x011", 4)
    assert swept.heard(bare, Sample("0x123", "hex", b"123")).type is None
    assert swept.heard(bare, Sample("", "hex", b"4142434445")).length == 5
