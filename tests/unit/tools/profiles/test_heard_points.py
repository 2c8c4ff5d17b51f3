"""What a vendor's tool asked for, out of a capture of it."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.io.capture import CaptureWriter
from multidrop.naming import DeviceName
from multidrop.protocols import PROTOCOLS, datalink, ultra3000
from multidrop.tools.profiles.heard_points import Heard, heard
from unit.tools.captures.captures import LINE, SLINK3, Talk, answer, question, refusal


def of(path: Path, profile: str, address: int, port: str = "") -> Heard:
    return heard(str(path), DeviceName(profile, address, port, {}), load_profile(profile))


def polled(path: Path) -> None:
    """1009 and 2000 of slave 2 every half second; 1009 moves, 2000 does not; 7 does not exist."""
    talk = Talk(path)
    for number in range(10):
        begun = talk.now
        for index, value in ((1009, 100 + number), (2000, 5)):
            asked = question(2, 2 * number % 16, index)
            talk.say(asked)
            talk.say(answer(asked, value))
        asked = question(2, 0, 7)
        talk.say(asked)
        talk.say(refusal(asked))
        other = question(3, 1, 4444)
        talk.say(other)
        talk.say(answer(other, 1))
        talk.now = begun + 500_000_000
    asked = question(2, 3, 2000)
    write = asked._replace(code=0x27, data=b"\x03" + asked.data[1:] + b"\x09\x00")
    talk.say(write)
    talk.say(answer(asked, 9)._replace(data=b""))
    too_high = write._replace(data=write.data[:3] + b"\x4d\x00").numbered(4)
    talk.say(too_high)
    talk.say(refusal(too_high, 0x12))
    talk.close()


def test_indices_types_values_and_periods(tmp_path: Path) -> None:
    path = tmp_path / "line.pcapng"
    polled(path)
    found = of(path, "ax-v", 2)
    known, new = found.points
    assert (known.description.name, known.reads, known.writes) == ("ipa_1009", 10, 0)
    assert known.values == [100, 109]
    assert known.every == pytest.approx(0.5)
    assert new.said == "read 10 times, every 0.5 s; written once; values 5..9"
    profile = found.profile("tool", "line.pcapng")
    assert list(profile.points) == ["ipa_1009", "ipa_1111", "index_2000"]
    point = profile.points["index_2000"]
    assert (point.at, point.role, point.note) == ("2000:int16", "unknown", new.said)
    assert profile.points["ipa_1009"] == load_profile("ax-v").points["ipa_1009"]


def test_nothing_of_it(tmp_path: Path) -> None:
    path = tmp_path / "line.pcapng"
    polled(path)
    with pytest.raises(UsageError, match="no values of slink3 address 9; addresses are: 2, 3"):
        of(path, "ax-v", 9)
    with pytest.raises(UsageError, match="addresses are: none"):
        of(path, "ultra3000", 2)
    with pytest.raises(UsageError, match="addresses are: none"):
        of(path, "ax-v", 2, "/dev/ttyUSB9")
    assert of(path, "ax-v", 2, "/dev/ttyUSB0").points


def test_one_value_and_a_capture_that_was_cut(tmp_path: Path) -> None:
    path = tmp_path / "line.pcapng"
    talk = Talk(path)
    asked = question(2, 3, 2000)
    talk.say(asked)
    talk.say(answer(asked, 9))
    talk.close()
    path.write_bytes(path.read_bytes() + b"\6\0\0\0")
    found = of(path, "ax-v", 2)
    assert [item.said for item in found.points] == ["read once; value 9"]
    assert found.notes


def test_an_ultra3000(tmp_path: Path) -> None:
    path = tmp_path / "line.pcapng"
    writer = CaptureWriter.create(path)
    line = writer.add_line(PROTOCOLS["ultra3000"], ultra3000.LINE)
    now = 0
    for parameter, function, asked, said in (
        (0x5B, 0, "03", "0300000010"),
        (0x5B, 2, "05", "0500000011"),
        (0x5B, 0, "01", "0100000012"),
        (0x300, 0, "", "ABC"),
        (0x301, 0, "", "0007"),
    ):
        for data in (asked, said):
            now += 10_000_000
            writer.add(line, ultra3000.Frame(1, parameter, function, data).encode(), now)
    writer.close()
    bare = tmp_path / "bare.toml"
    bare.write_text('[profile]\nname = "bare"\nprotocol = "ultra3000"\n')
    found = of(path, str(bare), 1).profile("tool", "x").points
    assert {item.at: (item.type, item.elements) for item in found.values()} == {
        "0x05B": ("uint32", 6),
        "0x300": (None, None),
        "0x301": ("uint16", None),
    }
    assert found["parameter_300"].note == "read once; value 0xABC"


def test_a_datalink_instrument(tmp_path: Path) -> None:
    path = tmp_path / "line.pcapng"
    writer = CaptureWriter.create(path)
    line = writer.add_line(PROTOCOLS["datalink"], datalink.LINE)
    frame = datalink.Frame(datalink.Command.INTERROGATE, 3, 0x600, 6)
    reply = datalink.Frame(datalink.Command.RESPONSE, 3, 0x600, 6, bytes(6))
    writer.add(line, frame.encode(), 10_000_000)
    writer.add(line, reply.encode(), 30_000_000)
    writer.close()
    assert [item.description.at for item in of(path, "53sl5100", 3).points] == ["C0", "C1"]


def test_no_capture_makes_it_fail_in_another_way(tmp_path: Path) -> None:
    """Damage and strays at random places; some of it is still heard."""
    dice = random.Random(5)
    path = tmp_path / "line.pcapng"
    writer = CaptureWriter.create(path)
    line = writer.add_line(SLINK3, LINE)
    now = 0
    for number in range(200):
        asked = question(2, number % 16, dice.choice((1009, 1111)))
        for frame in (asked, answer(asked, dice.randrange(100))):
            now += 5_000_000
            raw = frame.encode()
            if dice.random() < 0.2:
                writer.add(line, raw[: dice.randrange(1, len(raw))], now, damage="cut short")
            elif dice.random() < 0.9:
                writer.add(line, raw, now)
    writer.close()
    found = of(path, "ax-v", 2)
    assert {item.description.name for item in found.points} == {"ipa_1009", "ipa_1111"}
    assert all(0 <= value < 100 for item in found.points for value in item.values)  # type: ignore[operator]


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from multidrop.cli.main import run

    capture, out = tmp_path / "line.pcapng", tmp_path / "tool.toml"
    polled(capture)
    arguments = ["discover", "ax-v:2", "--from", str(capture), "-o", str(out)]
    assert run(arguments) == 0
    shown = capsys.readouterr()
    assert (
        "index_2000 (2000:int16)   read 10 times, every 0.5 s; written once; values 5..9"
        in shown.out
    )
    assert load_profile(str(out)).points["index_2000"].at == "2000:int16"
    assert run(arguments) == 2, "it is there already"
    assert run([*arguments, "--force", "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines[1]["values"] == [5, 9]
    assert run([*arguments, "--force", "--resume"]) == 2
