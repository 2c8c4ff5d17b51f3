"""What messages say together, in words and in values."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.profile import Profile
from multidrop.protocols.datalink import Command, Frame
from multidrop.protocols.datalink.explain import continues, explain
from multidrop.transaction import Kind, Meaning

MC5000 = load_profile("53mc5000")
SL6000 = load_profile("53sl6000")
ANY = load_profile("datalink")
C = 0x600
L = 0x500
ACKNOWLEDGE = Frame(Command.ACKNOWLEDGE, 3)


def interrogate(memory_address: int, count: int) -> Frame:
    return Frame(Command.INTERROGATE, 3, memory_address, count)


def response(memory_address: int, data: str) -> Frame:
    raw = bytes.fromhex(data)
    return Frame(Command.RESPONSE, 3, memory_address, len(raw), raw)


def change(memory_address: int, data: str, command: Command = Command.CHANGE) -> Frame:
    raw = bytes.fromhex(data)
    return Frame(command, 3, memory_address, len(raw), raw)


def bits(memory_address: int, data: str) -> Frame:
    return change(memory_address, data, Command.CHANGE_BITS)


def of(meaning: Meaning) -> list[tuple[str, str | None, Any]]:
    return [(p.text, p.name, sample.value) for p, sample in meaning.values]


def read(memory_address: int, data: str, profile: Profile = MC5000) -> Meaning:
    answer = response(memory_address, data)
    meaning = explain([interrogate(memory_address, answer.count), answer], profile)
    assert meaning.kind is Kind.READ
    assert meaning.complete
    return meaning


def test_neighbouring_points_are_several_values() -> None:
    meaning = read(C + 300, "64 00 07  40 00 01")
    assert of(meaning) == [("C100", "loop0_pv", 100.0), ("C101", "loop0_setpoint", 1.0)]
    assert meaning.text == "read loop0_pv (C100) = 100 EU, loop0_setpoint (C101) = 1 EU"
    assert meaning.fault is None
    assert meaning.refusal is None


def test_points_that_no_name_has_are_those_of_the_map() -> None:
    assert of(read(C + 3 * 700, "64 00 07")) == [("C700", None, 100.0)]
    assert of(read(0xF00 + 5 * 100, "45 70 00 00 0B")) == [("H100", None, 1111.0)]
    assert of(read(0x200 + 700, "FF")) == [("B700", None, 255)]
    assert of(read(0x1400 + 3100, b"TEXT".ljust(10).hex())) == [("A310", None, "TEXT")]
    assert of(read(0x1400 + 3105, b"HALF ".hex())) == [("F621", None, "HALF")]


def test_half_a_point_is_plain_memory() -> None:
    assert of(read(C + 300, "64 00 07 40")) == [
        ("C100", "loop0_pv", 100.0),
        ("mem/0x072F/1", None, b"\x40"),
    ]
    assert of(read(C + 301, "00 07 40 00 01")) == [
        ("mem/0x072D/2", None, b"\x00\x07"),
        ("C101", "loop0_setpoint", 1.0),
    ]


def test_described_bits_of_a_byte_and_no_others() -> None:
    meaning = read(L + 13, "09")  # L104 to L111
    assert {text: value for text, _, value in of(meaning)} == {
        "L104": True,
        "L105": False,
        "L106": False,
        "L107": True,
        "L108": False,
        "L110": False,
        "L111": False,
    }
    assert "loop0_automatic (L107) = True (automatic)" in meaning.text
    assert of(read(L + 250, "09")) == [("mem/0x05FA/1", None, b"\x09")]


def test_without_a_map_memory_is_memory() -> None:
    assert of(read(C + 300, "64 00 07 40 00 01", ANY)) == [
        ("mem/0x072C/6", None, bytes.fromhex("64 00 07 40 00 01"))
    ]
    assert of(read(0xFFF0, "01", MC5000)) == [("mem/0xFFF0/1", None, b"\x01")]
    assert of(read(0x9CF, "45 70 00 00 0B 00", SL6000)) == [
        ("H0", None, 1111.0),
        ("mem/0x09D4/1", None, b"\0"),
    ]
    assert of(read(0x9E8, "41", SL6000)) == [("mem/0x09E8/1", None, b"A")]


def test_memory_and_two_names_of_a_point_in_a_profile() -> None:
    profile = Profile.from_toml(
        '[profile]\nname="mine"\nprotocol="datalink"\nbases={L=0xA000}\n'
        '[points]\nblock={at="mem/0x4000/2"}\nmode={at="L3"}\nsame={at="L03"}\n',
        "mine.toml",
    )
    assert of(read(0x4000, "01 02", profile)) == [("mem/0x4000/2", "block", b"\1\2")]
    assert of(read(0xA000, "08", profile)) == [("L3", "mode", True)]
    assert of(explain([bits(0xA001, "FE 01")], profile)) == [("L8", None, True)]


def test_a_read_that_nobody_answers() -> None:
    meaning = explain([interrogate(C + 300, 3)], MC5000)
    assert (
        meaning[:-1] == Meaning(Kind.READ, "read loop0_pv (C100): no answer", complete=False)[:-1]
    )
    assert [point.name for point in meaning.unread] == ["loop0_pv"]
    assert explain([interrogate(0x1000, 0)], ANY).text == "read 1000h/0: no answer"
    empty = explain([interrogate(0x1000, 0), response(0x1000, "")], ANY)
    assert (empty.text, empty.values) == ("3 response 1000h =", ())


def test_a_change_is_a_write_with_its_echo_and_acknowledge() -> None:
    asked, echo = change(C + 303, "40 00 01"), response(C + 303, "40 00 01")
    text = "write loop0_setpoint (C101) := 1 EU"
    expected = [("C101", "loop0_setpoint", 1.0)]
    for frames, said, complete in (
        ([asked], "not acknowledged, no echo", False),
        ([asked, echo], "not acknowledged", False),
        ([asked, echo, ACKNOWLEDGE], "acknowledged", True),
        ([asked, ACKNOWLEDGE], "acknowledged, its echo was not heard", True),
    ):
        meaning = explain(frames, MC5000)
        assert meaning.text == f"{text}: {said}"
        assert meaning.kind is Kind.WRITE
        assert meaning.complete is complete
        assert of(meaning) == expected


def test_another_echo_is_said() -> None:
    asked, echo = change(C + 303, "40 00 01"), response(C + 303, "40 00 02")
    assert explain([asked, echo], MC5000).text.endswith(
        ": not acknowledged, another echo came: 40 00 02"
    )
    assert explain([asked, echo, ACKNOWLEDGE], MC5000).text.endswith(
        ": acknowledged, another echo came: 40 00 02"
    )


def test_changed_bits_are_points() -> None:
    asked = bits(L + 14, "FC 01")  # L112 to 1, L113 to 0
    meaning = explain([asked, response(L + 14, "FC 01"), ACKNOWLEDGE], MC5000)
    assert of(meaning) == [
        ("L112", "loop0_auto_switch", True),
        ("L113", "loop0_remote_switch", False),
    ]
    assert meaning.values[0][1].raw == b"\1"
    assert meaning.text == (
        "write loop0_auto_switch (L112) := True (automatic),"
        " loop0_remote_switch (L113) := False (local): acknowledged"
    )


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        (bits(L + 14, "FE 03"), "3 change bits 050Eh mask FE state 03"),  # the documents differ
        (bits(L + 14, "FF 00"), "3 change bits 050Eh mask FF state 00"),
        (bits(L + 14, "FF"), "3 change bits 050Eh := FF"),
        (bits(L + 256, "FE 01"), "3 change bits 0600h mask FE state 01"),
        (bits(L - 1, "FE 01"), "3 change bits 04FFh mask FE state 01"),
        (bits(0xFFFF, "FE 01 FE 01"), "3 change bits FFFFh mask FE state 01 mask FE state 01"),
        (change(0x1000, ""), "3 change 1000h :="),
    ],
)
def test_bits_that_are_no_points_are_shown_as_they_are(asked: Frame, text: str) -> None:
    meaning = explain([asked], MC5000)
    assert meaning.text == f"{text}: not acknowledged, no echo"
    assert meaning.values == ()


def test_bits_without_a_map_are_no_points() -> None:
    assert explain([bits(L + 14, "FE 01")], ANY).values == ()


def test_what_is_no_question_is_shown_as_it_is() -> None:
    assert explain([ACKNOWLEDGE], ANY) == Meaning(Kind.OTHER, "3 acknowledge")


def test_what_belongs_together() -> None:
    asked, echo = change(C, "40 00 01"), response(C, "40 00 01")
    assert continues((), asked)
    assert continues((), interrogate(C, 3))
    assert continues((), bits(L, "FE 01"))
    assert not continues((), echo)
    assert not continues((), ACKNOWLEDGE)
    assert continues([interrogate(C, 3)], echo)
    assert not continues([interrogate(C, 4)], echo)
    assert not continues([interrogate(C, 3)], ACKNOWLEDGE)
    assert not continues([interrogate(C, 3), echo], echo)
    assert not continues([echo], echo)
    assert continues([asked], echo)
    assert continues([asked], ACKNOWLEDGE)
    assert continues([asked, echo], ACKNOWLEDGE)
    assert not continues([asked, echo], Frame(Command.ACKNOWLEDGE, 4))
    assert not continues([asked, echo, ACKNOWLEDGE], ACKNOWLEDGE)


def test_many_stretches_are_not_remembered_for_ever() -> None:
    for address in range(5000):
        assert of(read(address, "07", ANY)) == [(f"mem/0x{address:04X}/1", None, b"\7")]


def test_a_profile_of_an_unknown_map_is_refused() -> None:
    with pytest.raises(UsageError, match="is none of map-a, map-b"):
        explain([interrogate(C, 3)], Profile("p", "datalink", dialect="map-z"))


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    command = draw(st.sampled_from(list(Command)))
    if command is Command.ACKNOWLEDGE:
        return Frame(command, 3)
    address = draw(st.sampled_from([0x500, 0x600, 0x72C, 0x1400, 0xFFF0]) | st.integers(0, 0xFFFF))
    if command is Command.INTERROGATE:
        return Frame(command, 3, address, draw(st.integers(0, 32)))
    data = draw(st.binary(max_size=32))
    return Frame(command, 3, address, len(data), data)


@given(st.lists(frames(), min_size=1, max_size=4), st.sampled_from([MC5000, SL6000, ANY]))
def test_no_frames_raise(together: list[Frame], profile: Profile) -> None:
    meaning = explain(together, profile)
    assert meaning.text
    assert continues(together, together[0]) in (True, False)


@given(st.integers(0, 0xFFFF), st.binary(min_size=1, max_size=32))
def test_every_byte_of_a_response_is_in_a_value(address: int, data: bytes) -> None:
    meaning = read(address, data.hex())
    covered = set()
    for point, sample in meaning.values:
        start = point.memory_address - address  # type: ignore[attr-defined]
        covered |= set(range(start, start + point.count))  # type: ignore[attr-defined]
        if point.letter != "L":  # type: ignore[attr-defined]
            assert data[start : start + point.count] == sample.raw  # type: ignore[attr-defined]
    assert covered == set(range(len(data)))
