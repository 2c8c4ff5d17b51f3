"""What questions and answers say, in words and in values."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.catalog import load_profile
from multidrop.profile import Profile
from multidrop.protocols.ultra3000 import Frame
from multidrop.protocols.ultra3000.explain import continues, explain
from multidrop.protocols.ultra3000.frame import REFUSED
from multidrop.transaction import Kind, Meaning, Refusal

DRIVE = load_profile("ultra3000")
ONE_ELEMENT = Profile.from_toml(
    '[profile]\nname="mine"\nprotocol="ultra3000"\n[points]\n'
    'third={at="0x300.3", type="uint16"}\nodd={at="0x301.7", type="int16|action", elements=9}\n',
    "mine.toml",
)


def ask(parameter: int, function: int = 0, data: str = "", address: int = 1) -> Frame:
    return Frame(address, parameter, function, data)


def of(meaning: Meaning) -> list[tuple[str, str | None, Any, str]]:
    return [(p.text, p.name, sample.value, sample.type) for p, sample in meaning.values]


def said(question: Frame, answer: str | None, profile: Profile = DRIVE) -> Meaning:
    """The meaning of a question with the answer of these digits."""
    return explain([question, question._replace(data=answer or "")], profile)


def refused(question: Frame, data: str) -> Frame:
    return question._replace(parameter=question.parameter + REFUSED, data=data)


def test_a_read_gives_name_unit_and_value() -> None:
    meaning = said(ask(0x06D), "FFFFFF9C")
    assert meaning == Meaning(
        Kind.READ, "read setpoint_velocity (0x06D) = -100 counts/s", meaning.values
    )
    assert of(meaning) == [("0x06D", "setpoint_velocity", -100, "int32")]
    assert meaning.values[0][1].raw == b"FFFFFF9C"


@pytest.mark.parametrize(("function", "view"), [(2, "nv"), (6, "default"), (8, "min"), (9, "max")])
def test_views(function: int, view: str) -> None:
    meaning = said(ask(0x039, function), "0A00")
    assert meaning.text == f"read motor_intermittent_current (0x039@{view}) = 20 A"


def test_elements_of_an_array() -> None:
    meaning = said(ask(0x02B, 0, "07"), "00000010")
    assert of(meaning) == [("0x02B.7", "preset_position_acceleration", 16, "uint32")]
    assert of(said(ask(0x02B, 0, "07"), "0700000010")) == of(meaning)
    written = said(ask(0x02B, 3, "0700000010"), "")
    assert of(written) == [("0x02B.7@nv", "preset_position_acceleration", 16, "uint32")]
    assert written.text == ("write preset_position_acceleration (0x02B.7@nv) := 16 counts/s^2: OK")
    assert said(ask(0x02B, 0, "FF"), "00000010").values[0][0].text == "0x02B.255"
    assert said(ask(0x02B), "00000010").values[0][0].text == "0x02B"


def test_a_parameter_that_nobody_describes() -> None:
    assert of(said(ask(0x300), "12AB")) == [("0x300", None, "0x12AB", "hex")]
    assert of(said(ask(0x300, 0, "03"), "12AB")) == [("0x300.3", None, "0x12AB", "hex")]
    assert of(said(ask(0x300, 1, "12AB"), "")) == [("0x300", None, "0x12AB", "hex")]
    assert of(said(ask(0x300, 0, "03"), "12AB", ONE_ELEMENT)) == [
        ("0x300.3", "third", 0x12AB, "uint16")
    ]


@pytest.mark.parametrize(
    ("question", "answer", "text"),
    [
        (ask(0x06D), None, "read setpoint_velocity (0x06D): no answer"),
        (ask(0x06D), "12", "read setpoint_velocity (0x06D) = 0x12"),
        (ask(0x075), "13", "read run_status (0x075) = 19 (E19 following error)"),
        (
            ask(0x02B, 10),
            "00",
            "read the least index of preset_position_acceleration (0x02B) = 0",
        ),
        (
            ask(0x02B, 11),
            "07",
            "read the greatest index of preset_position_acceleration (0x02B) = 7",
        ),
        (
            ask(0x02B, 11),
            "",
            "read the greatest index of preset_position_acceleration (0x02B) = 0",
        ),
        (ask(0x06D, 1, "00000064"), "", "write setpoint_velocity (0x06D) := 100 counts/s: OK"),
        (ask(0x06D, 1, "0064"), "", "write setpoint_velocity (0x06D) := 0x0064: OK"),
        (ask(0x06F, 1), "", "do reset_faults (0x06F): OK"),
        (ask(0x06F, 1), None, "do reset_faults (0x06F): no answer"),
        (ask(0x06F, 1, "12"), "", "write reset_faults (0x06F) := 0x12: OK"),
        (ask(0x022, 4), "", "load zero_speed_limit (0x022): OK"),
        (ask(0x022, 5), "", "save zero_speed_limit (0x022): OK"),
        (ask(0x022, 7), "", "restore the default of zero_speed_limit (0x022): OK"),
        (
            ask(0x02B, 7, "03"),
            "03",
            "restore the default of preset_position_acceleration (0x02B.3): OK",
        ),
        (ask(0x022, 12, "AB"), "", "reserved function Ch zero_speed_limit (0x022) AB: OK"),
        (ask(0x06F, 1, "", 255), None, "broadcast do reset_faults (0x06F)"),
        (
            ask(0x06D, 1, "00000064", 255),
            None,
            "broadcast write setpoint_velocity (0x06D) := 100 counts/s",
        ),
        (ask(0x301, 0, "07"), "07", "read 0x301.7 = 0x07"),
    ],
)
def test_what_is_said(question: Frame, answer: str | None, text: str) -> None:
    if answer is None:
        assert explain([question], DRIVE).text == text
    else:
        assert said(question, answer).text == text


def test_digits_of_half_an_action() -> None:
    assert said(ask(0x301, 0, "07"), "07", ONE_ELEMENT).text == "read odd (0x301.7) = 0x07"


@pytest.mark.parametrize(
    ("question", "kind"),
    [
        (ask(0x06D), Kind.READ),
        (ask(0x02B, 10), Kind.READ),
        (ask(0x06D, 1, "00000064"), Kind.WRITE),
        (ask(0x06F, 1), Kind.WRITE),
        (ask(0x022, 5), Kind.WRITE),
        (ask(0x022, 12), Kind.OTHER),
    ],
)
def test_kinds(question: Frame, kind: Kind) -> None:
    assert explain([question], DRIVE).kind is kind
    assert not explain([question], DRIVE).complete
    assert said(question, "").kind is kind
    assert explain([question._replace(address=255)], DRIVE).complete


def test_refusals() -> None:
    question = ask(0x06D, 1, "00000064")
    meaning = explain([question, refused(question, "04")], DRIVE)
    assert meaning.refusal == Refusal(4, "below the minimum")
    assert meaning.text == (
        "write setpoint_velocity (0x06D) := 100 counts/s: refused with 04, below the minimum"
    )
    assert of(meaning) == [("0x06D", "setpoint_velocity", 100, "int32")]
    nothing = explain([question, refused(question, "")], DRIVE)
    assert nothing.refusal == Refusal(None, "no code")
    read = ask(0x06D)
    for frames in ([read], [read, refused(read, "05")]):
        assert [point.name for point in explain(frames, DRIVE).unread] == ["setpoint_velocity"]
    alone = explain([refused(question, "04")], DRIVE)
    assert alone == Meaning(Kind.OTHER, "1 06D write working refused: below the minimum")


def test_a_text() -> None:
    (point,) = [p for p in DRIVE.points.values() if p.type == "string"][:1]
    parameter = int(point.at, 16)
    assert point.length is not None
    digits = b"ABC".ljust(point.length, b"\0").hex().upper()
    assert of(said(ask(parameter), digits)) == [(point.at, point.name, "ABC", "string")]


def test_what_may_be_a_question() -> None:
    assert continues((), ask(0x06D))
    assert continues((), ask(0x02B, 0, "07"))
    assert continues((), ask(0x06F, 1))
    assert continues((), ask(0x06D, 1, "00000064"))
    assert continues((), ask(0x022, 5))
    assert not continues((), ask(0x06D, 0, "00000064"))
    assert not continues((), ask(0x02B, 10, "07"))
    assert not continues((), refused(ask(0x06D), "04"))


def test_what_belongs_together() -> None:
    read, write, action = ask(0x02B, 0, "07"), ask(0x06D, 1, "00000064"), ask(0x06F, 1)
    assert continues([read], ask(0x02B, 0, "00000010"))
    assert continues([read], refused(read, "07"))
    assert not continues([read], ask(0x02C, 0, "00000010"))
    assert not continues([read, ask(0x02B, 0, "00000010")], ask(0x02B, 0, "00000010"))
    assert not continues([ask(0x06D)], ask(0x06D))
    assert not continues([ask(0x06D, 0, "00000064")], ask(0x06D, 0, "00000064"))
    assert continues([write], ask(0x06D, 1))
    assert continues([write], write)
    assert continues([write], refused(write, "04"))
    assert not continues([write], ask(0x06D, 1, "00000065"))  # the next setpoint
    assert continues([action], action)
    assert not continues([action._replace(address=255)], action._replace(address=255))


def test_many_questions_are_not_remembered_for_ever() -> None:
    for number in range(5000):
        data = f"{number:08X}"
        assert of(said(ask(0x06D, 1, data), "")) == [
            ("0x06D", "setpoint_velocity", number, "int32")
        ]


FRAMES = st.builds(
    Frame,
    address=st.sampled_from([0, 1, 255]),
    parameter=st.sampled_from([0x02B, 0x06D, 0x06F, 0x075, 0x301, 0x82B]) | st.integers(0, 0xFFF),
    function=st.integers(0, 15),
    data=st.text("0123456789ABCDEF", max_size=10),
)


@given(st.lists(FRAMES, min_size=1, max_size=3), st.sampled_from([DRIVE, ONE_ELEMENT]))
def test_no_frames_raise(together: list[Frame], profile: Profile) -> None:
    meaning = explain(together, profile)
    assert meaning.text
    assert continues(together, together[0]) in (True, False)


@given(FRAMES, st.text("0123456789ABCDEF", max_size=10), st.sampled_from([DRIVE, ONE_ELEMENT]))
def test_no_answer_raises(question: Frame, data: str, profile: Profile) -> None:
    assert said(question, data, profile).text
