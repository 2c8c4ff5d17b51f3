"""What questions and answers say, in words and in values."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import ROWS

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.profile import Profile
from multidrop.protocols.slink3 import Frame
from multidrop.protocols.slink3.explain import continues, explain
from multidrop.transaction import Kind, Meaning, Refusal

FLEXMAX = load_profile("flexmax")
ANY = load_profile("slink3")
AX_V = load_profile("ax-v")


def ask(code: int, data: str = "", *, address: int = 1, order: int = 0) -> Frame:
    return Frame(address, 4, order, code, bytes.fromhex(data))


def answer(code: int = 0, data: str = "", *, order: int = 1) -> Frame:
    return Frame(1, 4, order, code, bytes.fromhex(data))


def of(meaning: Meaning) -> list[tuple[str, str | None, Any, str]]:
    return [(p.text, p.name, sample.value, sample.type) for p, sample in meaning.values]


READ = ask(0x26, "03 2C 20")
WRITE = ask(0x27, "03 2C 20 D2 04")


def test_a_read_gives_point_name_and_value() -> None:
    meaning = explain([READ, answer(0, "03 2C 20 D2 04")], FLEXMAX)
    assert meaning[:2] == (Kind.READ, "read index_8236 (8236) = 1234")
    assert of(meaning) == [("8236", "index_8236", 1234, "int16")]
    assert meaning[3:] == (None, False, True, ())
    assert meaning.values[0][1].raw == b"\xd2\x04"


def test_a_unit_and_the_fault_bit_are_said() -> None:
    frames = [ask(0x24, "42 60 00"), answer(0, "42 60 00 DC 05", order=0x11)]
    meaning = explain(frames, FLEXMAX)
    assert meaning.text == "read speed_setpoint (std/0x6042.0) = 1500 rpm, FAULT"
    assert meaning.fault is True
    assert meaning.values[0][1].fault is True


def test_a_dialect_without_fault_bit_has_none() -> None:
    meaning = explain([READ, answer(0, "03 2C 20 D2 04", order=0x11)], AX_V)
    assert meaning.fault is None
    assert meaning.text == "read 8236 = 1234"


def test_a_name_behind_a_drive() -> None:
    profile = Profile.from_toml(
        '[profile]\nname="mine"\nprotocol="slink3"\ndialect="flexmax"\n'
        '[points.card]\nat="dgfc/511:uint8"\nnames={3="third"}\n',
        "mine.toml",
    )
    frames = [ask(0x26, "05 FF 01", order=4), answer(0, "05 FF 01 03", order=5)]
    assert explain(frames, profile).text == "read card (dgfc/511) = 3 (third)"
    assert explain(frames, FLEXMAX).text == "read dgfc/511 = 3"
    frames = [ask(0x26, "05 FF 01", order=6), answer(0, "05 FF 01 03", order=7)]
    assert explain(frames, profile).text == "read dest3/511 = 3"


@pytest.mark.parametrize(
    ("question", "reply", "text"),
    [
        (READ, None, "read 8236: no answer"),
        (ask(0x26, "80 2C 20 07"), answer(0, "89 2C 20 07 41 42 00"), "read 8236.7 = AB"),
        (READ, answer(0, "03 2C 20 D2 04 00"), "read 8236 = D2 04 00"),
        (READ, answer(0, "1F 2C 20 D2 04"), "read 8236 = D2 04"),
        (READ, answer(0, "83 2C 20"), "read 8236: an answer that is too short, 83 2C 20"),
        (READ, answer(0), "read 8236: an answer that is too short, empty"),
        (READ, answer(1), "read 8236: refused with 0001h, parameter does not exist"),
        (
            READ,
            answer(0x16),
            "read 8236: command submitted, its outcome is unknown, 0016h, which is no answer to it",
        ),
        (ask(0x24, "44 60 00"), answer(0, "44 60 00 05 00"), "read std/0x6044.0 = 05 00"),
        (
            ask(0x24, "40 60 00"),
            answer(0, "40 60 00 05 00"),
            "read control_word (std/0x6040.0) = 5",
        ),
        (ask(0x24, "44"), answer(0xFD), "read standard parameter 44: refused with 00FDh, ..."),
        (WRITE, None, "write 8236 := 1234: no answer"),
        (WRITE, answer(0), "write 8236 := 1234: OK"),
        (WRITE, answer(0x12), "write 8236 := 1234: refused with 0012h, above the maximum"),
        (WRITE, answer(0x16), "write 8236 := 1234: command submitted, its outcome is unknown"),
        (WRITE, answer(0x81), "write 8236 := 1234: a broadcast was received, 0081h, which is ..."),
        (ask(0x27, "03"), answer(0), "write typed parameter 03: OK"),
        (ask(0x25, "42 60 00 05 00"), answer(0), "write std/0x6042.0 := 05 00: OK"),
        (
            ask(0x23),
            answer(0, "37 02"),
            "status word 0237h: operation enabled (ready to switch on, ...",
        ),
        (ask(0x23), answer(0, "00 00"), "status word 0000h: not ready to switch on (no bit)"),
        (ask(0x23), answer(0, "37"), "status word: OK 37"),
        (ask(0x23), None, "status word: no answer"),
        (ask(0x23, "01"), answer(0xFD), "status word 01: refused with 00FDh, ..."),
        (ask(0x2F), answer(0, "10 23"), "malfunction code 2310h (current)"),
        (ask(0x2F), answer(0, "00 00"), "malfunction code 0000h"),
        (ask(0x2F), answer(0, ""), "malfunction code: OK"),
        (ask(0x28), answer(0x81), "broadcast command verify: a broadcast was received"),
        (ask(0x28), answer(0xFF), "broadcast command verify: no broadcast was received"),
        (ask(0x28), answer(0), "broadcast command verify: OK, 0000h, which is no answer to it"),
        (ask(0x28), answer(0x18), "broadcast command verify: refused with 0018h, unknown command"),
        (ask(0x20), answer(0), "reset slave: OK"),
        (
            ask(0xABCD, "11 22", order=4),
            answer(0, "33"),
            "special access of destination 2 11 22: OK 33",
        ),
        (ask(0x27, "03 2C 20 07 00", address=255), None, "broadcast write 8236 := 7"),
        (ask(0x20, address=128), None, "broadcast reset slave"),
        (answer(0), None, "1 #1 OK"),
    ],
)
def test_what_is_said(question: Frame, reply: Frame | None, text: str) -> None:
    found = explain([question] if reply is None else [question, reply], ANY).text
    assert found.startswith(text.removesuffix("...")) if text.endswith("...") else found == text


@pytest.mark.parametrize(
    ("question", "kind"),
    [
        (READ, Kind.READ),
        (ask(0x24, "44"), Kind.READ),
        (WRITE, Kind.WRITE),
        (ask(0x25, "44"), Kind.WRITE),
        (ask(0x23), Kind.STATUS),
        (ask(0x2F), Kind.STATUS),
        (ask(0x20), Kind.OTHER),
        (ask(0xABCD), Kind.OTHER),
    ],
)
def test_kinds(question: Frame, kind: Kind) -> None:
    assert explain([question], ANY).kind is kind
    assert not explain([question], ANY).complete
    assert explain([question, answer(0)], ANY).kind is kind


def test_what_was_asked_to_be_written_is_its_value_even_refused() -> None:
    meaning = explain([WRITE, answer(0x12)], ANY)
    assert of(meaning) == [("8236", None, 1234, "int16")]
    assert meaning.refusal == Refusal(0x12, "above the maximum")


@pytest.mark.parametrize("frames", [[READ], [READ, answer(1)]])
def test_a_read_without_a_value_names_its_point(frames: list[Frame]) -> None:
    meaning = explain(frames, FLEXMAX)
    assert meaning.values == ()
    assert [point.text for point in meaning.unread] == ["8236"]
    assert explain([READ, answer(0, "03 2C 20 D2 04")], FLEXMAX).unread == ()


def test_a_broadcast_waits_for_nobody() -> None:
    broadcast = ask(0x20, address=255)
    assert explain([broadcast], ANY).complete
    assert not continues([broadcast], Frame(255, 4, 1))


def test_what_belongs_together() -> None:
    good = answer(0, "03 2C 20 D2 04")
    assert continues((), READ)
    assert not continues((), good)
    assert continues([READ], good)
    assert not continues([READ], READ)
    assert not continues([READ], answer(0, "03 2D 20 D2 04"))
    assert not continues([READ], Frame(1, 8, 1, 1))  # another sequence number
    assert not continues([READ, good], good)
    assert not continues([good], good)


def test_many_questions_are_not_remembered_for_ever() -> None:
    for index in range(5000):
        data = index.to_bytes(2, "little")
        question = Frame(1, 4, 0, 0x26, b"\x03" + data)
        reply = Frame(1, 4, 1, 0, b"\x03" + data + data)
        assert of(explain([question, reply], ANY)) == [(str(index), None, index, "int16")]


def test_many_profiles_are_not_remembered_for_ever() -> None:
    for index in range(300):
        name = f"point_{index}"
        profile = Profile.from_toml(
            f'[profile]\nname="p"\nprotocol="slink3"\n[points.{name}]\nat="8236"\n', "p.toml"
        )
        assert explain([READ], profile).text == f"read {name} (8236): no answer"


def test_a_profile_of_an_unknown_dialect_is_refused() -> None:
    with pytest.raises(UsageError, match="is none of"):
        explain([READ], Profile("p", "slink3", dialect="klingon"))


@given(
    st.lists(ROWS[0].frames, min_size=1, max_size=3),
    st.sampled_from([FLEXMAX, ANY, AX_V]),
    st.data(),
)
def test_no_frames_raise(frames: list[Frame], profile: Profile, data: st.DataObject) -> None:
    if data.draw(st.booleans()):
        reply = data.draw(ROWS[0].frames)
        frames = [*frames, reply.numbered(frames[0].control >> 2)]
    meaning = explain(frames, profile)
    assert meaning.text
    for _, sample in meaning.values:
        assert isinstance(sample.raw, bytes)
    assert continues(frames, frames[0]) in (True, False)
