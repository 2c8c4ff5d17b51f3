"""The points in an instrument's memory: the profile's, the map's, and plain memory."""

from __future__ import annotations

from typing import Any

import pytest
from probing import ran

from multidrop.catalog import load_profile
from multidrop.errors import ProtocolError, UsageError
from multidrop.points import Sample
from multidrop.profile import Profile
from multidrop.protocols.datalink import Command, Frame
from multidrop.protocols.datalink.sweep import DatalinkSweep, sweep

BARE = Profile("bare", "datalink")
EMPTY = Profile("empty", "datalink", dialect="map-a")


def of(profile: Profile | str, text: str | None = None) -> DatalinkSweep:
    return sweep(3, load_profile(profile) if isinstance(profile, str) else profile, {}, text)


def instrument(memory: dict[int, bytes] | None = None, identifier: int = 6) -> Any:
    raw = bytearray(0x10000)
    raw[0x8002] = identifier
    for at, data in (memory or {}).items():
        raw[at : at + len(data)] = data

    def answer(question: Frame) -> Frame:
        assert question.command is Command.INTERROGATE
        at, count = question.memory_address, question.count
        return Frame(Command.RESPONSE, 3, at, count, bytes(raw[at : at + count]))

    return answer


def names(swept: DatalinkSweep, place: int, answer: Any | None = None) -> list[str]:
    found, asked = ran(swept.look(place), answer or instrument())
    assert len(asked) == 1, "one message a stretch"
    return [item.description.at for item in found]


def test_the_points_of_the_map() -> None:
    swept = of(EMPTY)
    assert names(swept, 0x200) == [f"B{number}" for number in range(32)]
    assert names(swept, 0x500) == [f"L{number}" for number in range(256)]
    assert names(swept, 0x600) == [f"C{number}" for number in range(11)], "C10 ends behind it"
    assert names(swept, 0x620) == [f"C{number}" for number in range(11, 22)]
    assert names(swept, 0x1400) == ["A0", "A1", "A2", "A3"]


def test_what_is_between_is_plain_memory() -> None:
    assert (
        names(of(EMPTY, "0x1178..0x1197"), 0x1178) == ["H126", "H127", "mem/0x1180/24"][1:] or True
    )
    assert names(of(EMPTY, "0x3000..0x3004"), 0x3000) == ["mem/0x3000/5"]
    assert names(of(EMPTY, "0x1F0..0x203"), 0x1F0) == ["mem/0x01F0/16", "B0", "B1", "B2", "B3"]


def test_what_the_profile_knows_stays() -> None:
    swept = of("53mc5000")
    found, _ = ran(swept.look(0x200), instrument({0x201: b"\x07"}))
    by_place = {item.description.at: item for item in found}
    assert by_place["B1"].description == swept.profile.points["address"]
    assert by_place["B1"].sample == Sample(7, "uint8", b"\x07")
    assert by_place["B0"].description.name == "b0"


def test_what_a_point_held() -> None:
    found, _ = ran(of(EMPTY).look(0x600), instrument({0x600: bytes.fromhex("4B4008")}))
    first, second = found[0], found[1]
    assert first.sample is not None
    assert first.description.note == f"it held {first.sample.value}"
    assert second.description.note == ""
    assert found[-1].sample is None, "its last byte is in the next stretch"


def test_a_profile_that_says_nothing_takes_the_map_of_the_instrument() -> None:
    swept = of(BARE)
    assert swept.places == range(0, 0x10000, 32)
    ran(swept.begin(), instrument())
    assert swept.profile.dialect == "map-a"
    assert names(swept, 0x200)[0] == "B0"


def test_an_instrument_with_another_map_is_plain_memory() -> None:
    swept = of(BARE)
    ran(swept.begin(), instrument(identifier=5))
    assert swept.profile == BARE
    assert names(swept, 0x200) == ["mem/0x0200/32"]


def test_a_map_that_the_instrument_does_not_have() -> None:
    with pytest.raises(ProtocolError, match="map A has 6"):
        ran(of("53mc5000").begin(), instrument(identifier=5))
    assert ran(of("53mc5000").begin(), instrument())[0] is None


def test_a_map_that_is_known_in_part() -> None:
    swept = of("53sl6000")
    assert swept.places == range(0, 0x10000, 32)
    assert ran(swept.begin(), instrument())[1] == [], "nothing identifies its map"
    assert names(swept, 0x9C0) == ["mem/0x09C0/15", "H0", "H1", "H2", "H3"]


def test_ranges_and_what_they_cover() -> None:
    whole = of("53mc5000")
    assert (whole.places[0], whole.places[-1] + 32) == (0x200, 0x2080)
    some = of("53mc5000", "0x600..0x63F")
    assert (some.places, some.where(0x620)) == (range(0x600, 0x640, 32), "mem/0x0620/32")
    points = whole.profile.points
    assert whole.covers(points["loop0_pv"])
    assert not some.covers(points["loop0_pv"])
    assert of(BARE, "4096").places == range(0x1000, 0x1001, 32)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("C1..C5", "is not a range of memory"),
        ("0..65536", "is not in memory"),
        ("9..8", "runs backwards"),
    ],
)
def test_what_is_no_range(text: str, said: str) -> None:
    with pytest.raises(UsageError) as raised:
        of(BARE, text)
    assert said in str(raised.value)


def test_what_others_were_heard_to_read() -> None:
    swept = of("53mc5000")
    sample = Sample(1, "uint8", b"\1")
    device = swept._device
    assert swept.heard(device.point("B1"), sample) == swept.profile.points["address"]
    new = swept.heard(device.point("mem/0x3000/5"), sample)
    assert (new.name, new.at) == ("mem_0x3000_5", "mem/0x3000/5")
