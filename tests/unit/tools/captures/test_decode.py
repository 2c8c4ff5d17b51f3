"""Decoding captures: what comes out, in how many parts and processes soever."""

from __future__ import annotations

import gc
import json
from pathlib import Path
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.io.capture import CaptureReader, CaptureWriter, Known
from multidrop.tools.captures.decode import Decoding, Done, decode
from multidrop.tools.captures.records import Filter
from multidrop.tools.captures.tally import Tally
from unit.tools.captures.captures import LINE, NOON, SLINK3, Talk, answer, busy, question, refusal


def decoded(
    path: Path, decoding: Decoding | None = None, **keys: Any
) -> tuple[list[dict[str, Any]], list[Done]]:
    done = list(decode(str(path), decoding or Decoding("json"), **keys))
    text = "".join(part.text for part in done)
    return [json.loads(line) for line in text.splitlines()], done


def test_a_read_a_refusal_and_a_question_without_an_answer(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    talk = Talk(path, Known(2, "ax-v", "winder"))
    asked = question(2, 1)
    talk.say(asked)
    talk.say(answer(asked, 125), 0.005)
    asked = question(2, 2, 77)
    talk.say(asked)
    talk.say(refusal(asked), 0.004)
    talk.say(question(5, 3))
    talk.close()
    (read, refused, silent), (done,) = decoded(path)
    assert read == {
        "v": 1,
        "time": "2023-11-14T22:13:20.035500Z",
        "device": "ax-v:2@/dev/ttyUSB0",
        "kind": "read",
        "point": "1009",
        "name": "ipa_1009",
        "value": 125,
        "unit": None,
        "type": "int16",
        "raw": "7d00",
        "fault": None,
        "ms": pytest.approx(24 * LINE.character * 1000 + 5, abs=0.002),
        "answer_ms": pytest.approx(5.0, abs=0.002),
        "text": "read ipa_1009 (1009) = 125",
    }
    assert refused["error"] == {"kind": "refused", "code": 1, "text": "parameter does not exist"}
    assert (refused["point"], refused["value"], silent["point"]) == ("77", None, "1009")
    assert refused["answer_ms"] == pytest.approx(4.0, abs=0.002)
    assert silent["error"] == {"kind": "no-reply", "text": "no answer"}
    assert (silent["device"], silent["ms"]) == ("slink3:5@/dev/ttyUSB0", None)
    assert done.tally.frames == 5
    assert done.tally.no_reply == 1
    assert list(done.tally.devices) == ["winder", "slink3:5"]


def test_damage_and_strays_are_records_too(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    talk = Talk(path)
    talk.spoil(b"\x55\xaa")
    talk.say(answer(question(3, 1), 5))
    talk.close()
    (damage, stray), _ = decoded(path)
    assert (damage["kind"], damage["raw"], damage["error"]) == (
        "damage",
        "55aa",
        {"kind": "damaged", "text": "no START"},
    )
    assert "device" in damage
    assert damage["device"] is None
    assert (stray["kind"], stray["device"]) == ("stray", "slink3:3@/dev/ttyUSB0")
    assert stray["error"]["kind"] == "stray"


@pytest.mark.parametrize("size", [1 << 14, 30_000])
@pytest.mark.parametrize("style", ["json", "text", "frames-json"])
def test_parts_change_nothing(tmp_path: Path, size: int, style: str) -> None:
    path = tmp_path / "a.pcapng"
    busy(path, 2000)
    whole = list(decode(str(path), Decoding(style)))
    cut = list(decode(str(path), Decoding(style), processes=1, size=size))
    assert len(whole) == 1
    assert len(cut) > 4
    assert "".join(part.text for part in cut) == whole[0].text
    tally = Tally()
    for part in cut:
        tally.add(part.tally)
    assert tally == whole[0].tally
    assert cut[-1].seconds == whole[0].seconds


def test_processes_keep_the_order(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    busy(path, 2000)
    whole, _ = decoded(path)
    cut, done = decoded(path, processes=2, size=30_000)
    assert len(done) > 4
    assert cut == whole


def test_parts_after_a_new_section(tmp_path: Path) -> None:
    """Two captures one behind the other: a part knows the lines that were described before it."""
    one, two, both = tmp_path / "1", tmp_path / "2", tmp_path / "both"
    busy(one, 1000)
    busy(two, 1000, faults=False)
    both.write_bytes(one.read_bytes() + two.read_bytes())
    found, done = decoded(both, processes=1, size=30_000)
    assert len(done) > 4
    assert found == decoded(one)[0] + decoded(two)[0]
    times = [packet.time_ns for packet in CaptureReader(one).packets()]
    back = (times[-1] - next(CaptureReader(two).packets()).time_ns) / 1e9
    assert [note for part in done for note in part.notes] == [
        f"packet {len(times) + 1}: the clock goes back by {back:,.1f} s"
    ]


def test_parts_of_several_lines(tmp_path: Path) -> None:
    """What is open on a line that is silent from then on comes out all the same."""
    path = tmp_path / "a.pcapng"
    talk = Talk(path)
    others = [talk.writer.add_line(SLINK3, LINE, f"COM{number}") for number in range(3)]
    for number in range(1200):
        if number % 300 == 100:
            talk.writer.add(others[number // 300 % 3], question(7, 1).encode(), talk.now)
        talk.say(question(1, number % 16))
        talk.say(answer(question(1, number % 16), number))
    talk.close()
    whole, _ = decoded(path)
    cut, done = decoded(path, processes=1, size=20_000)
    assert len(done) > 4
    assert len(cut) == len(whole) == 1204
    assert sorted(map(str, cut)) == sorted(map(str, whole))


def test_a_clock_that_jumps_is_told_and_pairs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    talk = Talk(path)
    talk.say(question(1, 1))
    talk.now -= 7_200_000_000_000
    talk.say(answer(question(1, 1), 5))
    talk.now += 36_000_000_000_000
    talk.say(question(1, 2))
    talk.say(answer(question(1, 2), 6))
    talk.close()
    found, (done,) = decoded(path)
    assert [line["error"]["kind"] if "error" in line else "ok" for line in found] == [
        "no-reply",
        "stray",
        "ok",
    ]
    assert done.notes == [
        "packet 2: the clock goes back by 7,200.0 s",
        "packet 3: nothing for 10.0 hours, or the clock was set",
    ]


def test_a_capture_that_is_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    busy(path, 200)
    whole, _ = decoded(path)
    path.write_bytes(path.read_bytes()[:-7])
    found, done = decoded(path)
    assert 0 < len(found) <= len(whole)
    assert "the file is cut short" in done[-1].notes[0]


def test_a_capture_that_is_broken_in_the_middle(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    busy(path, 2000)
    content = bytearray(path.read_bytes())
    reader = CaptureReader(path)
    ends = [reader.at for _ in reader.packets()]
    content[ends[2000] - 4] ^= 0xFF  # the second length of a block
    path.write_bytes(content)
    for size in (1 << 20, 30_000):
        found, done = decoded(path, processes=1, size=size)
        assert done[-1].notes == [
            f"the file is broken from byte {ends[1999]} on: the two lengths of a block differ"
        ]
        assert sum(part.tally.frames + part.tally.damaged for part in done) == 2000
        assert len(found) > 900


def test_no_packets(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    Talk(path).close()
    found, (done,) = decoded(path)
    assert (found, done.notes) == ([], ["holds no packets"])


def test_filters(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    busy(path, 400)
    everything, _ = decoded(path)

    def count(**wanted: tuple[str, ...]) -> int:
        return len(decoded(path, Decoding("json", Filter(**wanted)))[0])

    infeed = [line for line in everything if str(line["device"]).startswith("flexmax:1@")]
    assert count(devices=("infeed",)) == count(devices=("1",)) == len(infeed) > 100
    assert count(devices=("flexmax:*",)) == len(infeed)
    ipa = [line for line in everything if line["name"] == "ipa_1009"]
    assert count(points=("ipa*",)) == count(points=("1009",)) == len(ipa) > 100
    assert count(points=("1009",), kinds=("refused",)) > 3
    for kind, key in (("refused", "refused"), ("no-reply", "no-reply"), ("damage", "damaged")):
        of_kind = [line for line in everything if line.get("error", {}).get("kind") == key]
        assert count(kinds=(kind,)) == len(of_kind) > 3
    assert count(kinds=("refused", "no-reply"), devices=("2",)) == len(
        [
            line
            for line in everything
            if line.get("error", {}).get("kind") in ("refused", "no-reply")
            and str(line["device"]).startswith("ax-v:2@")
        ]
    )


def test_profiles_go_before_what_the_capture_says(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    talk = Talk(path, Known(2, "gone", "winder"))
    talk.say(question(2, 1))
    talk.say(answer(question(2, 1), 125))
    talk.close()
    (line,), (done,) = decoded(path)
    assert (line["device"], line["name"]) == ("slink3:2@/dev/ttyUSB0", None)
    assert done.notes[0].startswith("device 2: there is no profile 'gone'")
    given = Decoding("json", profiles={2: load_profile("ax-v")})
    (line,), (done,) = decoded(path, given)
    assert (line["device"], line["name"]) == ("ax-v:2@/dev/ttyUSB0", "ipa_1009")
    assert done.notes == []
    with pytest.raises(UsageError, match="profile 53mc5000 is of datalink"):
        decoded(path, Decoding("json", profiles={2: load_profile("53mc5000")}))


def test_bytes_of_no_known_protocol_are_told(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    writer = CaptureWriter.create(path)
    line = writer.add_line(None, LINE, "/dev/ttyUSB0")
    now = NOON
    for number in range(4):
        asked = question(2, number)
        for raw in (asked.encode(), answer(asked, number).encode()):
            now += 20_000_000
            writer.add(line, raw[:5], now - 8_000_000)
            writer.add(line, raw[5:], now)
    writer.close()
    found, _ = decoded(path)
    assert [item["value"] for item in found] == [0, 1, 2, 3]


def test_bytes_that_nobody_understands_are_damage(tmp_path: Path) -> None:
    path = tmp_path / "b.pcapng"
    writer = CaptureWriter.create(path)
    writer.add(writer.add_line(None, LINE), b"\x55" * 20, NOON)
    writer.close()
    (line,), _ = decoded(path)
    assert line["error"]["text"] == "no known protocol"


def test_frames_by_their_fields(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    talk = Talk(path, sent=True)
    talk.say(question(2, 1))
    talk.say(answer(question(2, 1), 125))
    talk.spoil(b"\x55")
    talk.close()
    found, _ = decoded(path, Decoding("frames-json"))
    assert found[1] == {
        "v": 1,
        "number": 2,
        "time": "2023-11-14T22:13:20.033500Z",
        "direction": "received",
        "protocol": "slink3",
        "raw": answer(question(2, 1), 125).encode().hex(),
        "address": 2,
        "control": 4,
        "order": 1,
        "code": 0,
        "data": "03f1037d00",
    }
    assert [item["direction"] for item in found] == ["sent", "received", None]
    assert found[2]["error"] == {"kind": "damaged", "text": "no START"}
    (text,) = [part.text for part in decode(str(path), Decoding("frames"))]
    assert "2 #1 OK 1009:int16 = 125" in text.splitlines()[1]


def test_packets_of_another_writer_may_hold_several_frames(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    writer = CaptureWriter.create(path)
    line = writer.add_line(SLINK3, LINE, "p")
    raw = question(2, 1).encode() + answer(question(2, 1), 7).encode() + b"\x01"
    writer.add(line, raw, NOON)
    writer.close()
    found, _ = decoded(path)
    assert [item["kind"] for item in found] == ["read", "damage"]
    assert found[0]["value"] == 7


def test_a_part_leaves_nothing_in_memory(tmp_path: Path) -> None:
    """Worker processes look for no garbage, so there must be none."""
    path = tmp_path / "a.pcapng"
    busy(path, 500)
    gc.collect()
    gc.disable()
    try:
        for _ in decode(str(path), Decoding("json"), processes=1, size=10_000):
            pass
        assert not [item for item in gc.get_objects() if type(item).__name__ == "_Work"]
    finally:
        gc.enable()
