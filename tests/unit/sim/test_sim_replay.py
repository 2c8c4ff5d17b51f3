"""Devices that answer as a capture has it."""

from __future__ import annotations

from pathlib import Path

import pytest

from multidrop.errors import UsageError
from multidrop.io.capture import CaptureWriter, Known
from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000
from multidrop.sim.faults import Fault, ScriptedFaults
from multidrop.sim.line import Connection, LineFaults, SimulatedLine
from multidrop.sim.replay import Learned, learn
from unit.tools.captures.captures import NOON, Talk, answer, question, refusal


def ask(wire: Connection, raw: bytes, now: float, wait: float = 1.0) -> bytes:
    wire.receive(raw, now)
    return wire.send(now + wait)


def line_of(learned: Learned) -> SimulatedLine:
    return SimulatedLine(learned.devices, learned.settings.decoder)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.pcapng"


def test_answers_come_in_turn_and_begin_again(path: Path) -> None:
    talk = Talk(path, Known(2, "ax-v", "winder"))
    for number, value in enumerate((10, 11, 12)):
        asked = question(2, number)
        talk.say(asked)
        talk.say(answer(asked, value), 0.005)
    talk.close()
    wire = line_of(learn(path)).attach()
    for turn, value in enumerate((10, 11, 12, 10, 11)):
        asked = question(2, 15 - turn)  # whatever the sequence number was
        assert ask(wire, asked.encode(), float(turn)) == answer(asked, value).encode()


def test_after_the_time_that_the_device_took(path: Path) -> None:
    talk = Talk(path)
    for after in (0.005, 0.020):
        talk.say(question(2, 1))
        talk.say(answer(question(2, 1), 1), after)
    talk.close()
    learned = learn(path)
    wire = line_of(learned).attach()
    for start, after in ((1.0, 0.005), (2.0, 0.020)):
        wire.receive(question(2, 1).encode(), start)
        assert wire.deadline == pytest.approx(start + after, abs=1e-6)
        assert wire.send(start + after * 0.9) == b""
        assert wire.send(start + after * 1.1) == answer(question(2, 1), 1).encode()
    assert "1 questions, 2 answers after 12.5 ms (median)" in list(learned.lines())[1]


def test_refusals_and_missing_answers_are_replayed(path: Path) -> None:
    talk = Talk(path)
    talk.say(question(2, 1))
    talk.now += 200_000_000
    talk.say(question(2, 2))
    talk.say(refusal(question(2, 2), 7))
    talk.say(question(2, 3))
    talk.close()
    learned = learn(path)
    assert list(learned.lines()) == [
        "learned from slink3 9600 8E1 /dev/ttyUSB0",
        "  address 2: 1 questions, 1 answers after 3.0 ms (median), 1 times no answer",
    ]  # the last question may have been answered when nobody listened any more
    wire = line_of(learned).attach()
    for turn in range(2):
        assert ask(wire, question(2, 4).encode(), 2.0 * turn) == b""
        assert ask(wire, question(2, 5).encode(), 2.0 * turn + 1) == (
            refusal(question(2, 5), 7).encode()
        )


def test_what_was_never_asked_is_not_known(path: Path) -> None:
    talk = Talk(path)
    talk.say(question(2, 1))
    talk.say(answer(question(2, 1), 1))
    talk.say(question(3, 1))
    talk.say(question(2, 1))
    talk.close()
    wire = line_of(learn(path)).attach()
    unheard = question(2, 6, 77)
    assert ask(wire, unheard.encode(), 0.0) == refusal(unheard, 1).encode()
    service = slink3.Frame(2, 4, 0, 0x03)
    assert (
        ask(wire, service.encode(), 1.0)
        == refusal(service, slink3.Response.UNKNOWN_COMMAND).encode()
    )
    assert ask(wire, question(3, 1).encode(), 2.0) == b""  # it never answered
    assert ask(wire, answer(question(2, 1), 1).encode(), 3.0) == b""


def test_faults_of_the_line_come_on_top(path: Path) -> None:
    talk = Talk(path)
    talk.say(question(2, 1))
    talk.say(answer(question(2, 1), 1))
    talk.close()
    line = line_of(learn(path))
    line.faults = LineFaults(ScriptedFaults([Fault.OTHER_SLAVE, Fault.WRONG_SEQUENCE]))
    wire = line.attach()
    assert ask(wire, question(2, 1).encode(), 0.0) == (
        answer(question(2, 1), 1)._replace(address=3).encode()
    )
    assert ask(wire, question(2, 1).encode(), 1.0) == answer(question(2, 8), 1).encode()


def written(path: Path, protocol: str, *frames: datalink.Frame | ultra3000.Frame) -> None:
    writer = CaptureWriter.create(path)
    line = writer.add_line(PROTOCOLS[protocol], PROTOCOLS[protocol].line)
    for number, frame in enumerate(frames):
        writer.add(line, frame.encode(), NOON + number * 20_000_000)
    writer.close()


def test_datalink_echoes_and_is_silent_at_an_acknowledge(path: Path) -> None:
    asked = datalink.Frame(0xE0, 1, 0x0101, 2)
    given = datalink.Frame(0x20, 1, 0x0101, 2, b"\x7e\x01")
    change = datalink.Frame(0xA0, 1, 0x0101, 1, b"\x05")
    echo = datalink.Frame(0x20, 1, 0x0101, 1, b"\x05")
    acknowledge = datalink.Frame(0x80, 1)
    written(path, "datalink", asked, given, change, echo, acknowledge)
    wire = line_of(learn(path)).attach()
    assert ask(wire, asked.encode(), 0.0) == given.encode()
    assert ask(wire, change.encode(), 1.0) == echo.encode()
    assert ask(wire, acknowledge.encode(), 2.0) == b""
    assert ask(wire, datalink.Frame(0xE0, 1, 0x0202, 2).encode(), 3.0) == b""


def test_ultra3000_refuses_what_it_does_not_know(path: Path) -> None:
    asked, given = ultra3000.Frame(1, 0x06D), ultra3000.Frame(1, 0x06D, 0, "0000000A")
    write = ultra3000.Frame(1, 0x06D, 1, "00000001")
    done = ultra3000.Frame(1, 0x06D, 1)
    written(path, "ultra3000", asked, given, write, done)
    wire = line_of(learn(path)).attach()
    assert ask(wire, asked.encode(), 0.0) == given.encode()
    assert ask(wire, write.encode(), 1.0) == done.encode()
    refused = ultra3000.Frame.decode(ask(wire, ultra3000.Frame(1, 0x001).encode(), 2.0))
    assert refused.is_refusal


def test_captures_that_teach_nothing(path: Path, tmp_path: Path) -> None:
    talk = Talk(path)
    talk.say(question(2, 1))
    talk.close()
    with pytest.raises(UsageError, match="no question that was answered"):
        learn(path)
    raw = tmp_path / "b.pcapng"
    writer = CaptureWriter.create(raw)
    writer.add(writer.add_line(None, slink3.LINE), b"abc", NOON)
    writer.add(writer.add_line(PROTOCOLS["slink3"], slink3.LINE, "COM1"), b"abc", NOON)
    writer.close()
    with pytest.raises(UsageError, match="bytes of no known protocol"):
        learn(raw)
    writer = CaptureWriter.create(raw)
    for port in ("COM1", "COM2"):
        line = writer.add_line(PROTOCOLS["slink3"], slink3.LINE, port)
        writer.add(line, question(2, 1).encode(), NOON)
    writer.close()
    with pytest.raises(UsageError, match="several lines, COM1 and COM2"):
        learn(raw)
