"""A blocking line: turns, taps, marks, strays, and what is left when somebody breaks off."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.conversation import Ask, Conversation, Tell, Wait
from multidrop.errors import DeviceError, NoReply, PortError, UsageError
from multidrop.io.line import Line, Timed, open_line
from multidrop.io.memory import FOREVER, MemoryPort
from multidrop.naming import LineOptions
from multidrop.protocols import datalink, slink3
from multidrop.protocols.slink3 import Frame
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault
from multidrop.sim.line import SimulatedLine
from unit.io.lines import AX, DRIVE, INT, blocking, scripted, simulated

READ = bytes.fromhex("01 02 00 0B 00 26 00 03 F1 03 DE")
ANSWER = bytes.fromhex("01 02 00 0D 01 00 00 03 F1 03 7D 00 82")


class Peer:
    """Answers each request with what it is given: the raw bytes of a port."""

    def __init__(self, *answers: bytes) -> None:
        self.answers = list(answers)
        self.waiting = b""

    def receive(self, data: bytes, now: float) -> None:
        if self.answers:
            self.waiting += self.answers.pop(0)

    @property
    def deadline(self) -> float:
        return 0.0 if self.waiting else FOREVER

    def send(self, now: float) -> bytes:
        data, self.waiting = self.waiting, b""
        return data


def test_the_time_of_an_answer() -> None:
    line = blocking(simulated(faults=scripted(Fault.LATE_ANSWER, late=0.25)))
    timed = line.timed(AX.read_typed(1009, INT))
    assert timed.result.value == 125
    assert (timed.received_at, timed.seconds) == (0.25, 0.25)


def test_the_gap_before_the_next_request() -> None:
    line = blocking()
    for _ in range(3):
        line.run(AX.read_typed(1009, INT))
    assert line.port.now() == pytest.approx(2 * 0.002)


def test_taps_see_every_byte_with_its_time() -> None:
    line = blocking(simulated(faults=scripted(Fault.LATE_ANSWER, late=0.25)))
    seen: list[tuple[bytes, bool, float, bool]] = []
    line.taps.append(lambda *event: seen.append(event))
    line.run(AX.read_typed(1009, INT))
    assert seen == [(READ, True, 0.0, False), (ANSWER, False, 0.25, False)]


def test_taps_see_bytes_without_the_ports_marks_and_which_were_wrong() -> None:
    wrong = ANSWER[:11] + b"\xff\x00\x7d" + ANSWER[12:]
    line = Line(MemoryPort(Peer(wrong, ANSWER), marks=True), slink3.LINE, LineOptions())
    seen: list[tuple[bytes, bool, bool]] = []
    line.taps.append(lambda data, sent, now, damaged: seen.append((data, sent, damaged)))
    with pytest.raises(NoReply):
        line.run(AX.read_typed(1009, INT))
    assert (b"\x7d", False, True) in seen


def test_a_byte_with_a_parity_error_is_damage_though_the_checksum_holds() -> None:
    """Two flips in one bit column pass the checksum: only the port's mark tells."""
    wrong = ANSWER[:10] + b"\xff\x00\x7d" + ANSWER[11:]
    line = Line(MemoryPort(Peer(wrong), marks=True), slink3.LINE, LineOptions())
    with pytest.raises(NoReply) as caught:
        line.run(AX.read_typed(1009, INT))
    assert b"\x7d" in caught.value.damaged
    unmarked = Line(MemoryPort(Peer(ANSWER), marks=True), slink3.LINE, LineOptions())
    assert unmarked.run(AX.read_typed(1009, INT)).value == 125


def test_strays_are_counted_and_not_believed() -> None:
    peer = Peer(ANSWER)
    line = Line(MemoryPort(peer), slink3.LINE, LineOptions())
    peer.waiting = ANSWER  # right address, right number, right index: and nobody has asked
    assert line.run(AX.read_typed(1009, INT)).value == 125
    assert (line.counters.foreign, line.counters.answers) == (1, 1)


class Flood(Peer):
    """Has bytes waiting that no single read takes."""

    def __init__(self, pieces: float) -> None:
        super().__init__(ANSWER)
        self.pieces = pieces
        self.left_at_request = 0.0

    def receive(self, data: bytes, now: float) -> None:
        super().receive(data, now)
        self.left_at_request = self.pieces

    def send(self, now: float) -> bytes:
        if self.pieces > 0:
            self.pieces -= 1
            return b"\xff" * 4096
        return super().send(now)


class Ticking(MemoryPort):
    """Reading takes time, as it does everywhere."""

    def read(self, timeout: float) -> bytes:
        self._now += 0.001
        return super().read(timeout)


def test_all_that_waits_is_drained_before_the_request() -> None:
    flood = Flood(5)
    line = Line(MemoryPort(flood), slink3.LINE.with_options(gap=0.0), LineOptions(echo="off"))
    assert line.run(AX.read_typed(1009, INT)).value == 125
    assert flood.left_at_request == 0


def test_a_line_that_never_falls_silent_is_no_trap() -> None:
    line = Line(Ticking(Flood(float("inf"))), slink3.LINE, LineOptions())
    with pytest.raises(NoReply):
        line.run(AX.read_typed(1009, INT))


def test_a_conversation_keeps_the_line_from_its_first_to_its_last_step() -> None:
    def steps() -> Conversation[Frame, list[int]]:
        first = yield Ask(Frame(0, 0, 0, 0x23), True)
        yield Wait(0.5)
        yield Tell(Frame(255, 0, 0, 0x27, b"\x03\x2c\x20\x07\x00"))
        second = yield Ask(Frame(0, 0, 0, 0x26, b"\x03\x2c\x20"), True)
        return [first.code, second.data[3]]

    line = blocking()
    assert line.run(steps()) == [0, 7]
    assert line.port.now() > 0.5


class SlowPort(MemoryPort):
    """One whose `write` returns only after 15 ms."""

    def write(self, data: bytes) -> None:
        super().write(data)
        self._now += 0.015


def test_an_acknowledge_counts_as_sent_when_it_is_written() -> None:
    wire = SimulatedLine([simulated_device("53mc5000", 3)], datalink.decoder)
    line = Line(SlowPort(wire.attach()), datalink.LINE, LineOptions())
    line.run(datalink.Master(3).change(0x73E, bytes.fromhex("4B 40 08")))
    assert line.delays.number == 1
    assert line.delays.last == pytest.approx(0.015)


def test_whether_something_else_than_reads_went_out() -> None:
    line = blocking(simulated(faults=scripted(None, None, Fault.NO_ANSWER)))
    line.run(DRIVE.read_typed(8236, INT))
    assert not line.acted
    line.run(DRIVE.write_typed(8236, INT, 1))
    assert line.acted
    with pytest.raises(NoReply):
        line.run(DRIVE.write_typed(8236, INT, 2))
    assert line.acted
    with pytest.raises(UsageError):
        line.run(DRIVE.write_typed(8236, INT, 99999))
    assert not line.acted


class Interrupted(Peer):
    """Ctrl-C comes while the first answer is awaited; that answer comes during the second request."""

    requests = 0
    interrupted = False

    def receive(self, data: bytes, now: float) -> None:
        self.requests += 1
        if self.requests > 1:
            super().receive(data, now)

    @property
    def deadline(self) -> float:
        return 0.0 if self.requests == 1 and not self.interrupted else super().deadline

    def send(self, now: float) -> bytes:
        if self.requests == 1 and not self.interrupted:
            self.interrupted = True
            raise KeyboardInterrupt
        return super().send(now)


def test_a_late_answer_to_what_was_broken_off_is_not_believed() -> None:
    """The number that was in flight rests: the old OK must not confirm a new write."""
    ok = Frame(2, 0, 1).encode()
    line = Line(MemoryPort(Interrupted(ok)), slink3.LINE, LineOptions())
    with pytest.raises(KeyboardInterrupt):
        line.run(AX.write_typed(1009, INT, 1))
    assert line.acted
    sent = []
    line.taps.append(lambda data, out, now, damaged: sent.append(data) if out else None)
    with pytest.raises(NoReply):
        line.run(AX.write_typed(1009, INT, 2))
    assert Frame.decode(sent[0]).control == 4
    assert line.counters.foreign == 1


def test_the_number_of_what_was_broken_off_rests() -> None:
    """Sixteen numbers come round in a fraction of a second: the one in flight is left out."""
    line = blocking()
    read, numbers = line.port.read, []
    line.taps.append(lambda data, out, now, damaged: numbers.append(data[2] >> 2) if out else None)

    def interrupted(timeout: float) -> bytes:
        if timeout > 0:
            raise KeyboardInterrupt
        return b""

    line.port.read = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        line.run(AX.read_typed(1009, INT))
    line.port.read = read  # type: ignore[method-assign]
    for _ in range(16):
        line.run(AX.read_typed(1009, INT))
    assert numbers == [0, *range(1, 16), 1]


def sent_by(line: Line) -> list[bytes]:
    """What goes out from now on, frame by frame."""
    sent: list[bytes] = []
    line.taps.append(lambda data, out, now, damaged: sent.append(data) if out else None)
    return sent


def test_one_behind_the_other_the_next_is_asked_before_a_result_is_given() -> None:
    line = Line(MemoryPort(simulated().attach()), slink3.LINE.with_options(gap=0.0), LineOptions())
    sent = sent_by(line)
    values, asked = [], []
    for found in line.each(AX.read_typed(index, INT) for index in (1009, 1009, 1009)):
        assert isinstance(found, Timed)
        values.append(found.result.value)
        asked.append(len(sent))
    assert values == [125, 125, 125]
    assert asked == [2, 3, 3]


def test_one_behind_the_other_the_gap_is_kept_and_what_is_done_meanwhile_costs_nothing() -> None:
    line = blocking()
    started = []
    line.taps.append(lambda data, out, now, damaged: started.append(now) if out else None)
    for _ in line.each(AX.read_typed(1009, INT) for _ in range(3)):
        line.port.read(0.0015)  # less than the gap
    assert started == pytest.approx([0.0, 0.002, 0.004])


def test_an_error_is_given_before_the_next_one_is_asked() -> None:
    line = blocking(simulated(faults=scripted(None, *[Fault.NO_ANSWER] * 3)))
    sent = sent_by(line)
    found, asked = [], []
    for outcome in line.each(AX.read_typed(index, INT) for index in (1009, 1009, 9999, 1009)):
        found.append(type(outcome))
        asked.append(len(sent))
    assert found == [Timed, NoReply, DeviceError, Timed]
    assert asked == [1, 4, 5, 6]  # the gap was not over when the first was given


def test_who_uses_the_line_in_between_gives_up_what_is_on_its_way() -> None:
    line = Line(MemoryPort(simulated().attach()), slink3.LINE.with_options(gap=0.0), LineOptions())
    sent = sent_by(line)
    each = line.each(AX.read_typed(1009, INT) for _ in range(3))
    assert isinstance(next(each), Timed)
    for _ in range(16):
        assert line.run(AX.read_typed(1009, INT)).value == 125
    assert line.counters.foreign == 1  # the answer that nobody waited for
    numbers = [Frame.decode(data).control >> 2 for data in sent]
    assert numbers == [0, 1, *range(2, 16), 0, 2], "the number of what was given up rests"
    broken_off, rest = each
    assert isinstance(broken_off, NoReply)
    assert str(broken_off) == "the line was used for something else in 1 attempt"
    assert isinstance(rest, Timed)


def test_a_port_that_is_lost_between_two_of_them_loses_no_result() -> None:
    class Lost(MemoryPort):
        left = 1

        def write(self, data: bytes) -> None:
            if not self.left:
                raise PortError("gone")
            self.left -= 1
            super().write(data)

    line = Line(Lost(simulated().attach()), slink3.LINE.with_options(gap=0.0), LineOptions())
    found = [type(item) for item in line.each(AX.read_typed(1009, INT) for _ in range(3))]
    assert found == [Timed, PortError, PortError]


def test_a_line_that_is_closed_with_its_block() -> None:
    closed = []

    class Port(MemoryPort):
        def close(self) -> None:
            closed.append(True)

    with Line(Port(Peer()), slink3.LINE):
        assert not closed
    assert closed == [True]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"boud": 1}, "did you mean 'baud'"),
        ({"timeout": 0}, "out of range"),
        ({"echo": "x"}, "none of"),
    ],
)
def test_options_that_are_wrong(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        open_line("tcp://127.0.0.1:1", slink3.LINE, **options)


def test_a_port_that_cannot_be_opened() -> None:
    with pytest.raises(PortError, match=r"tcp://127\.0\.0\.1:1: connection refused"):
        open_line("tcp://127.0.0.1:1", slink3.LINE, timeout=0.5)
