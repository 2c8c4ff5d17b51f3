"""Which parameters a slave has: by the types that it names, or by those that it refuses."""

from __future__ import annotations

from typing import Any

import pytest
from probing import ran

from multidrop.catalog import load_profile
from multidrop.errors import DeviceError, UsageError
from multidrop.points import Sample
from multidrop.profile import Profile
from multidrop.protocols.slink3 import Frame
from multidrop.protocols.slink3.sweep import Slink3Sweep, sweep

Known = dict[int, tuple[int, str]]
"""Index -> its type code and value, or 0 and the RESPONSE of any read."""


def answers(known: Known, *, names: bool, destination: int = 0) -> Any:
    def answer(question: Frame) -> Frame:
        type_code, index = question.data[0], question.data[1] | question.data[2] << 8
        code, data = 0x01, b""
        if question.destination != destination:
            code = 0x10
        elif index in known:
            has, value = known[index]
            if has == 0:
                code = int(value, 16)
            elif type_code == has or (type_code == 0 and names):
                code, data = 0, bytes((has,)) + question.data[1:3] + bytes.fromhex(value)
            else:
                code = 0x1E if type_code == 0 else 0x06
        return Frame(1, question.control, question.order | 1, code, data)

    return answer


def of(profile: str | Profile, text: str | None = None) -> Slink3Sweep:
    return sweep(1, load_profile(profile) if isinstance(profile, str) else profile, {}, text)


def own(points: str) -> Profile:
    head = '[profile]\nname = "own"\nprotocol = "slink3"\ndialect = "flexmax"\n[points]\n'
    return Profile.from_toml(head + points, "own.toml")


def looked(swept: Slink3Sweep, place: int, answer: Any) -> tuple[list[tuple[str, str, str]], int]:
    """Name, `at` and note of each point, and how many reads that took."""
    found, asked = ran(swept.look(place), answer)
    assert {frame.code for frame in asked} == {0x26}
    return [
        (item.description.name, item.description.at, item.description.note) for item in found
    ], len(asked)


def test_a_slave_that_names_types_is_asked_once() -> None:
    answer = answers({7: (3, "7D00"), 9: (1, "01")}, names=True)
    swept = of("ax-v")
    assert looked(swept, 7, answer) == ([("index_7", "7:int16", "it held 125")], 1)
    assert looked(swept, 9, answer) == ([("index_9", "9:bool", "it held True")], 1)
    assert looked(swept, 8, answer) == ([], 1)


def test_a_flexmax_is_asked_for_its_types_in_turn() -> None:
    answer = answers({7: (3, "7D00"), 9: (8, "0000C03F"), 11: (9, "4142")}, names=False)
    swept = of("flexmax")
    assert looked(swept, 7, answer) == ([("index_7", "7:int16", "it held 125")], 1)
    assert looked(swept, 9, answer) == ([("index_9", "9:float32", "it held 1.5")], 5)
    assert looked(swept, 11, answer) == ([("index_11", "11:string", "it held AB")], 6)
    assert looked(swept, 8, answer) == ([], 1)


def test_a_type_that_the_dialect_does_not_have() -> None:
    note = "there, and not read: refused with code 0006h: the parameter has another type"
    answer = answers({7: (5, "01")}, names=False)
    assert looked(of("flexmax"), 7, answer) == ([("index_7", "7", note)], 6)
    named = answers({7: (5, "01"), 8: (0x0F, "00")}, names=True)
    assert looked(of("ax-v"), 7, named)[0] == [("index_7", "7", "of type uint8; it held 1")]
    assert looked(of("ax-v"), 8, named)[0] == [("index_8", "8", "of type type0Fh; it held 00")]


def test_a_parameter_that_may_not_be_read_is_there() -> None:
    note = "there, and not read: refused with code 001Dh: password protection"
    answer = answers({7: (0, "1D"), 8511: (0, "1D")}, names=False)
    assert looked(of("flexmax"), 7, answer) == ([("index_7", "7", note)], 1)
    assert looked(of("flexmax"), 8511, answer)[0][0][:2] == ("address", "8511:uint16")


def test_a_refusal_that_says_neither_is_raised() -> None:
    with pytest.raises(DeviceError, match="destination option does not exist"):
        ran(of("flexmax", "dgfc/0..9").look(3), answers({}, names=True))


def test_what_the_profile_knows_stays_and_its_type_is_asked_first() -> None:
    answer = answers({8511: (6, "0100"), 8236: (6, "0200")}, names=False)
    swept = of("flexmax")
    found, asked = ran(swept.look(8511), answer)
    assert [item.description for item in found] == [swept.profile.points["address"]]
    assert found[0].sample == Sample(1, "uint16", b"\x01\x00", None)
    assert len(asked) == 1
    other = [("index_8236", "8236:uint16", "the profile has type int16, the device uint16")]
    assert looked(swept, 8236, answer)[0] == other


def test_a_place_may_have_several_names_and_no_type() -> None:
    swept = of(own('a = { at = "7" }\nb = { at = "7:int32" }\nc = { at = "7.1:int16" }'))
    answer = answers({7: (3, "7D00")}, names=False)
    found, _ = looked(swept, 7, answer)
    assert [item[:2] for item in found] == [("a", "7"), ("b", "7:int16")]


def test_what_is_behind_a_drive() -> None:
    swept = of("flexmax", "dgfc/500..600")
    assert (swept.where(511), swept.places) == ("dgfc/511", range(500, 601))
    answer = answers({511: (5, "07")}, names=True, destination=2)
    assert looked(swept, 511, answer) == ([("dgfc_index_511", "dgfc/511:uint8", "it held 7")], 1)
    numbered = of("flexmax", "dest3/5")
    answer = answers({5: (5, "07")}, names=False, destination=3)
    assert looked(numbered, 5, answer)[0] == [("dest3_index_5", "dest3/5:uint8", "it held 7")]


def test_what_a_sweep_covers() -> None:
    points = 'a = { at = "7:int16" }\nb = { at = "9:int16" }\nc = { at = "7.1:int16" }\n'
    profile = own(points + 'd = { at = "dgfc/7:int16" }\ne = { at = "std/0x0007.0:int16" }')

    def covered(text: str | None) -> list[str]:
        swept = of(profile, text)
        return [name for name, item in profile.points.items() if swept.covers(item)]

    assert covered(None) == ["a", "b"]
    assert covered("0..8") == ["a"]
    assert covered("0..9.0..3") == ["c"]
    assert covered("7.2..3") == []
    assert covered("dgfc/0..8") == ["d"]
    assert covered("std/0..8") == ["e"]
    assert covered("std/0..8.1") == []


def test_ranges() -> None:
    assert of("flexmax").places == range(65536)
    assert of("flexmax", "0x10..0x1F").places == range(16, 32)
    assert of("flexmax", " 8236 ").places == range(8236, 8237)
    assert of("flexmax", "8236").what == of("flexmax", "std/0x6000..0x6010").what == "indices"
    assert ran(of("flexmax").begin(), lambda frame: frame) == (None, [])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("8000-9000", "is not a range of indices: [DEST/]FIRST..LAST"),
        ("9..8", "runs backwards"),
        ("0..65536", "index 65536 of '65536' is out of range"),
        ("drive/0..8", "is no destination of flexmax"),
        ("7.0..256", "subindex 256 of '7.256' is out of range"),
        ("7.3..2", "runs backwards"),
        ("7...3", "is not a range of indices"),
    ],
)
def test_what_is_no_range(text: str, said: str) -> None:
    with pytest.raises(UsageError) as raised:
        of("flexmax", text)
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("profile", "text", "said"),
    [("ax-v", "7.0..3", "ax-v has no subindex"), ("ax-v", "std/0..8", "no standard parameters")],
)
def test_ranges_that_a_dialect_does_not_have(profile: str, text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        of(profile, text)


def test_subindices() -> None:
    swept = of("flexmax", "8236..8237.2..5")
    assert swept.what == "subindices"
    assert [swept.where(place) for place in swept.places] == [
        f"{index}.{subindex}" for index in (8236, 8237) for subindex in (2, 3, 4, 5)
    ]

    def answer(question: Frame) -> Frame:
        form, subindex = question.data[0], question.data[3]
        there = (form, subindex) == (0x86, 4)
        data = question.data + b"\x05\x00" if there else b""
        code = 0 if there else 6 if subindex == 4 else 1
        return Frame(1, question.control, question.order | 1, code, data)

    found = [looked(swept, place, answer) for place in swept.places[:4]]
    assert found == [
        ([], 1),
        ([], 1),
        ([("index_8236_4", "8236.4:uint16", "it held 5")], 3),
        ([], 1),
    ]


def standard(known: dict[int, str]) -> Any:
    """Answers reads of standard parameters: index -> value, or RESPONSE where that is one byte short."""

    def answer(question: Frame) -> Frame:
        assert question.code == 0x24
        index, subindex = question.data[0] | question.data[1] << 8, question.data[2]
        value = known.get(index) if subindex == 0 else None
        if value is None or len(value) == 1:
            return Frame(1, question.control, question.order | 1, int(value or "1", 16))
        data = question.data + bytes.fromhex(value)
        return Frame(1, question.control, question.order | 1, 0, data)

    return answer


def seen(swept: Slink3Sweep, answer: Any) -> list[tuple[str, str, str, object]]:
    found = []
    for place in swept.places:
        items, asked = ran(swept.look(place), answer)
        assert len(asked) == 1
        found += [
            (item.description.name, item.description.at, item.description.note, item.sample)
            for item in items
        ]
    return found


def test_a_standard_parameter_has_the_type_that_its_width_allows() -> None:
    answer = standard({0x6100: "05", 0x6101: "0200", 0x6103: "00000100", 0x6104: "414243"})
    swept = of("flexmax", "std/0x6100..0x6104")
    said = "its type is not known, only its width; it held"
    assert [(name, at, note) for name, at, note, _ in seen(swept, answer)] == [
        ("std_index_0x6100_0", "std/0x6100.0:uint8", f"{said} 5"),
        ("std_index_0x6101_0", "std/0x6101.0:uint16", f"{said} 2"),
        ("std_index_0x6103_0", "std/0x6103.0:uint32", f"{said} 65536"),
        ("std_index_0x6104_0", "std/0x6104.0:bytes", f"{said} 41 42 43"),
    ]


def test_a_standard_parameter_of_the_profile() -> None:
    swept = of(
        own('a = { at = "std/0x6041.0:uint16" }\nb = { at = "std/0x6042.0:int16" }'),
        "std/0x6041..0x6042",
    )
    found = seen(swept, standard({0x6041: "2700", 0x6042: "FFFFFFFF"}))
    assert found == [
        ("a", "std/0x6041.0:uint16", "", Sample(0x27, "uint16", b"\x27\0", None)),
        (
            "b",
            "std/0x6042.0:uint32",
            "the profile has type int16, the device 4 bytes",
            Sample(0xFFFFFFFF, "uint32", b"\xff" * 4, None),
        ),
    ]


def test_a_standard_parameter_that_may_not_be_read_is_there() -> None:
    note = "there, and not read: refused with code 0003h: control access denied"
    found = seen(of("flexmax", "std/0x6040..0x6100"), standard({0x6040: "3", 0x6100: "3"}))
    assert [(name, at) for name, at, _, _ in found] == [
        ("control_word", "std/0x6040.0:uint16"),
        ("std_index_0x6100_0", "std/0x6100.0:bytes"),
    ]
    assert found[1][2:] == (note, None)


def test_a_refusal_of_all_standard_parameters_is_raised() -> None:
    def answer(question: Frame) -> Frame:
        return Frame(1, question.control, question.order | 1, 0x18)

    with pytest.raises(DeviceError, match="unknown command"):
        ran(of("flexmax", "std/0x6040").look(0x6040), answer)


def test_what_others_were_heard_to_read() -> None:
    swept = of("flexmax")
    sample = Sample(5, "int16", b"\5\0", None)
    known = swept.heard(swept._device.point("8236"), sample)
    assert known == swept.profile.points["index_8236"]
    new = [swept.heard(swept._device.point(text), sample) for text in ("7", "dgfc/7.2")]
    assert [(item.name, item.at) for item in new] == [
        ("index_7", "7:int16"),
        ("dgfc_index_7_2", "dgfc/7.2:int16"),
    ]
