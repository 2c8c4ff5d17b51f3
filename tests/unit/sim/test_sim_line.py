"""The simulated line: the time that bytes take, bursts, echo, faults."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Frame
from multidrop.sim.faults import Fault
from multidrop.sim.line import LineFaults, Pace
from unit.sim.wires import heard, scripted, simulated

CHARACTER = 11 / 9600
READ = Frame(2, 0, 0, 0x26, b"\x03\xf1\x03")  # IPA 1009, short int: 11 bytes, answered with 13
ANSWER = bytes.fromhex("01 02 00 0D 01 00 00 03 F1 03 7D 00 82")


def test_an_unpaced_line_answers_at_once() -> None:
    end = simulated().attach()
    end.receive(READ.encode(), 5.0)
    assert heard(end) == [(5.0, ANSWER)]


def test_requests_cut_anywhere() -> None:
    end = simulated().attach()
    for byte in READ.encode():
        end.receive(bytes([byte]), 1.0)
    assert heard(end) == [(1.0, ANSWER)]


def test_every_byte_has_its_time_on_a_paced_line() -> None:
    end = simulated(pace=Pace(CHARACTER, answer_delay=0.003)).attach()
    end.receive(READ.encode(), 1.0)
    pieces = heard(end)
    start = 1.0 + 11 * CHARACTER + 0.003
    assert b"".join(data for _, data in pieces) == ANSWER
    assert [at for at, _ in pieces] == pytest.approx(
        [start + (number + 1) * CHARACTER for number in range(13)], abs=1e-9
    )


def test_times_are_absolute() -> None:
    """However late the line is asked what it has sent, the next byte is not later for it."""
    line = simulated(pace=Pace(CHARACTER))
    end = line.attach()
    now = 0.0
    for _ in range(500):
        end.receive(READ.encode(), now)
        assert end.send(now + 20.5 * CHARACTER) == ANSWER[:9]
        now = heard(end)[-1][0]
    assert now == pytest.approx(500 * 24 * CHARACTER, abs=1e-6)


def test_a_request_waits_for_the_line_to_be_free() -> None:
    line = simulated(pace=Pace(CHARACTER))
    end = line.attach()
    end.receive(READ.encode(), 0.0)
    end.receive(READ.encode(), 0.001)  # over the first answer: it is taken behind it
    assert heard(end)[-1][0] == pytest.approx(48 * CHARACTER)


def test_two_masters_share_the_wire() -> None:
    line = simulated(pace=Pace(CHARACTER))
    one, other = line.attach(), line.attach()
    one.receive(READ.encode(), 0.0)
    other.receive(READ.encode(), 0.0)
    assert heard(one)[-1][0] == pytest.approx(24 * CHARACTER)
    assert heard(other)[-1][0] == pytest.approx(48 * CHARACTER)


@given(burst=st.floats(0.0005, 0.05), delay=st.floats(0, 0.02), address=st.sampled_from([0, 2]))
def test_bursts_deliver_every_byte_after_it_passed_and_soon(
    burst: float, delay: float, address: int
) -> None:
    request = Frame(address, 0, 0, 0x26, b"\x03\xf1\x03" if address else b"\x03\x2c\x20")
    end = simulated(pace=Pace(CHARACTER, burst, delay)).attach()
    end.receive(request.encode(), 0.0)
    start = 11 * CHARACTER + delay
    sent = 0
    for at, data in heard(end):
        for number in range(sent, sent + len(data)):
            passed = start + (number + 1) * CHARACTER
            assert passed - 1e-6 * CHARACTER * 2 <= at <= passed + burst + 1e-9
        sent += len(data)
    assert sent == 13


def test_bursts_of_16_ms() -> None:
    end = simulated(pace=Pace(CHARACTER, 0.016)).attach()
    end.receive(READ.encode(), 0.0)
    assert [data for _, data in heard(end)] == [ANSWER]  # 13 characters take 14.9 ms
    end = simulated(pace=Pace(CHARACTER, 0.008)).attach()
    end.receive(READ.encode(), 0.0)
    assert [len(data) for _, data in heard(end)] == [6, 7]


def test_echo_comes_before_the_answer() -> None:
    end = simulated(faults=scripted(echo=True)).attach()
    end.receive(READ.encode(), 0.0)
    assert b"".join(data for _, data in heard(end)) == READ.encode() + ANSWER


def test_paced_echo_comes_byte_by_byte_while_the_request_leaves() -> None:
    end = simulated(pace=Pace(CHARACTER), faults=scripted(echo=True)).attach()
    end.receive(READ.encode(), 0.0)
    pieces = heard(end)
    assert b"".join(data for _, data in pieces) == READ.encode() + ANSWER
    assert [at for at, _ in pieces] == pytest.approx(
        [(number + 1) * CHARACTER for number in range(24)]
    )


def test_half_a_request_is_forgotten_after_a_silence() -> None:
    end = simulated().attach()
    end.receive(READ.encode()[:6], 0.0)
    assert end.deadline == pytest.approx(0.3)
    assert end.send(0.3) == b""
    end.receive(READ.encode(), 0.4)
    assert heard(end) == [(0.4, ANSWER)]


def faulty(fault: Fault, late: float = 1.0) -> list[tuple[float, bytes]]:
    """What comes of a request whose answer has this fault."""
    end = simulated(faults=scripted(fault, late=late)).attach()
    end.receive(READ.encode(), 0.0)
    return heard(end)


def test_no_answer() -> None:
    assert faulty(Fault.NO_ANSWER) == []


def test_late_answer() -> None:
    assert faulty(Fault.LATE_ANSWER, late=1.7) == [(1.7, ANSWER)]


@pytest.mark.parametrize("pace", [Pace(), Pace(CHARACTER)])
def test_a_late_answer_does_not_hold_back_those_behind_it(pace: Pace) -> None:
    """Only one answer is late: the request that follows is heard and answered in its time."""
    end = simulated(pace=pace, faults=scripted(Fault.LATE_ANSWER, late=1.0)).attach()
    end.receive(READ.encode(), 0.0)
    end.receive(READ.numbered(1).encode(), 0.5)
    prompt, late = heard(end, 0.9), heard(end)
    assert Frame.decode(b"".join(data for _, data in prompt)).control == 4
    assert prompt[-1][0] == pytest.approx(0.5 + 24 * pace.character)
    assert b"".join(data for _, data in late) == ANSWER
    assert late[-1][0] == pytest.approx(1.0 + 24 * pace.character)


def test_wrong_checksum() -> None:
    ((_, data),) = faulty(Fault.WRONG_CHECKSUM)
    assert data[:-1] == ANSWER[:-1]
    assert data[-1] != ANSWER[-1]


def test_cut_short() -> None:
    ((_, data),) = faulty(Fault.CUT_SHORT)
    assert data == ANSWER[:6]


def test_noise_before_the_frame() -> None:
    ((_, data),) = faulty(Fault.NOISE)
    assert data.endswith(ANSWER)
    assert data != ANSWER


def test_the_answer_of_another_slave() -> None:
    ((_, data),) = faulty(Fault.OTHER_SLAVE)
    assert Frame.decode(data) == Frame.decode(ANSWER)._replace(address=3)


def test_a_wrong_sequence_number() -> None:
    ((_, data),) = faulty(Fault.WRONG_SEQUENCE)
    assert Frame.decode(data)._replace(control=0) == Frame.decode(ANSWER)
    assert Frame.decode(data).control not in (0, 4)


def test_faults_are_of_answers_one_by_one() -> None:
    end = simulated(faults=scripted(None, Fault.NO_ANSWER, None)).attach()
    found = []
    for number in range(4):
        end.receive(READ.numbered(number).encode(), float(number))
        found.append([at for at, _ in heard(end)])
    assert found == [[0.0], [], [2.0], [3.0]]


def test_a_line_has_no_faults_of_its_own() -> None:
    line = simulated()
    assert line.faults.faults.draw() is None
    assert not line.faults.echo
    assert line.pace == Pace()
    assert isinstance(line.faults, LineFaults)
    assert slink3.LINE.character == pytest.approx(CHARACTER)
