"""A sweep finds who answers, however late and however damaged, and speaks over nobody."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise

import pytest

from multidrop.io.memory import MemoryPort
from multidrop.protocols.datalink import Command
from multidrop.protocols.datalink import Frame as DatalinkFrame
from multidrop.protocols.slink3 import Frame
from multidrop.protocols.ultra3000 import Frame as UltraFrame
from multidrop.tools.scan.sweep import MOST_SILENT, ONCE, TWICE
from unit.tools.scan.scanned import Pieces, Wire, begun, carry_out, sweep

ALL = range(128)
CHARACTER = 11 / 9600


def answer_to(question: Frame) -> bytes:
    return Frame(question.address, question.control, 1, 0, b"\x50\x02").encode()


def present(*addresses: int, after: float = 0.02) -> Callable[[Frame], Pieces]:
    """Slaves whose answer is complete so long after the probe."""
    return lambda frame: [(after, answer_to(frame))] if frame.address in addresses else []


def test_who_answers_is_found_and_asked_once() -> None:
    wire = Wire("slink3", present(0, 5, 127))
    done = sweep(wire, ALL)
    assert set(done.found) == {0, 5, 127}
    assert wire.addresses() == list(ALL)
    found = done.found[5]
    assert found.ms == pytest.approx(20 - 10 * CHARACTER * 1000, abs=0.1)
    assert found.said == "5 #0 OK 50 02"
    assert found.doubt == ""
    assert not done.damaged
    assert done.foreign is None


def test_a_refusal_is_an_answer() -> None:
    refusal = Frame(3, 0, 1, 0x18).encode()
    wire = Wire("slink3", lambda frame: [(0.02, refusal)] if frame.address == 3 else [])
    assert set(sweep(wire, ALL).found) == {3}


def test_how_long_it_takes() -> None:
    wire = Wire("slink3", present(0, 1, 2))
    port = MemoryPort(wire)
    carry_out(begun(wire, ALL), port)
    assert port.now() == pytest.approx(128 * (8 * CHARACTER + 0.1) + 1.5, abs=0.1)


def test_probes_rest_and_wait() -> None:
    wire = Wire("slink3", present(1, after=0.0995))
    sweep(wire, range(4))
    ends = [item.end for item in wire.asked]
    assert ends[1] - ends[0] == pytest.approx(8 * CHARACTER + 0.1)
    # the answer's last byte, then 2 ms, then the next probe
    assert ends[2] - ends[1] == pytest.approx(8 * CHARACTER + 0.0995 + 0.002)


@pytest.mark.parametrize("after", [0.03, 0.12, 0.35, 0.8, 1.2, 1.45])
def test_late_answers_count(after: float) -> None:
    """From 30 ms to 1.5 s: what comes while others are asked counts, and is asked again alone."""
    wire = Wire("slink3", present(40, after=after))
    done = sweep(wire, ALL)
    assert set(done.found) == {40}
    assert done.found[40].doubt == ""
    assert done.found[40].ms == pytest.approx(after * 1000 - 10 * CHARACTER * 1000, abs=1)
    asked = [item for item in wire.asked if item.frame.address == 40]
    assert len(asked) == (1 if after < 0.1 else 2)
    assert wire.addresses()[:128] == list(ALL)
    assert done.counted.strays == 0


def test_the_last_address_is_waited_for() -> None:
    wire = Wire("slink3", present(127, after=1.4))
    assert set(sweep(wire, ALL).found) == {127}


def test_after_that_an_answer_is_nobodys() -> None:
    wire = Wire("slink3", present(7, after=1.8))
    done = sweep(wire, ALL)
    assert not done.found
    assert done.counted.strays == 1


def test_who_was_late_is_not_waited_for_again() -> None:
    """Asked alone he has 1.5 s, but once he has answered only a second answer is waited for."""
    wire = Wire("slink3", present(4, after=0.3))
    port = MemoryPort(wire)
    carry_out(begun(wire, range(8)), port)
    quick = 8 * (8 * CHARACTER + 0.1) + 1.5
    assert port.now() == pytest.approx(quick + 8 * CHARACTER + 0.3 + 0.1, abs=0.01)


def test_several_slow_drives() -> None:
    wire = Wire("slink3", present(3, 4, 5, 90, after=0.6))
    assert set(sweep(wire, ALL).found) == {3, 4, 5, 90}


def test_late_once_and_never_again() -> None:
    wire = Wire(
        "slink3",
        lambda frame: [(0.5, answer_to(frame))] if frame[:2] == (9, 0) else [],
    )
    done = sweep(wire, ALL)
    assert done.found[9].doubt == ONCE


@pytest.mark.parametrize("name", ["slink3", "datalink", "ultra3000"])
def test_an_echo_is_no_device(name: str) -> None:
    wire = Wire(name, echo=True)
    done = sweep(wire, range(32))
    assert not done.found
    assert not done.damaged
    assert done.foreign is None
    assert done.counted.echoes == 32
    assert len(wire.asked) == 32


def test_devices_behind_an_echo() -> None:
    wire = Wire("slink3", present(2, 30), echo=True)
    assert set(sweep(wire, range(32)).found) == {2, 30}

    def instrument(frame: DatalinkFrame) -> Pieces:
        answer = DatalinkFrame(Command.RESPONSE, frame.address, frame.memory_address, 1, b"\x06")
        return [(0.02, answer.encode())] if frame.address == 3 else []

    assert set(sweep(Wire("datalink", instrument, echo=True), range(32)).found) == {3}

    def drive(frame: UltraFrame) -> Pieces:
        return [(0.02, frame._replace(data="02000005").encode())] if frame.address == 4 else []

    assert set(sweep(Wire("ultra3000", drive, echo=True), range(32)).found) == {4}


def test_two_devices_with_one_address_are_damage() -> None:
    wire = Wire(
        "slink3", lambda frame: [(0.02, b"\x01\x06\x55\xaa\x00")] if frame.address == 6 else []
    )
    done = sweep(wire, ALL)
    assert not done.found
    assert done.damaged == {6: b"\x01\x06\x55\xaa\x00"}
    assert wire.addresses()[128:] == [6]


def test_two_devices_with_one_address_and_different_times() -> None:
    def both(frame: Frame) -> Pieces:
        return [(0.02, answer_to(frame)), (0.06, answer_to(frame))] if frame.address == 6 else []

    done = sweep(Wire("slink3", both), ALL)
    assert done.found[6].doubt == TWICE


def test_damage_beside_an_answer() -> None:
    def noisy(frame: Frame) -> Pieces:
        return [(0.02, b"\x77" + answer_to(frame))] if frame.address == 6 else []

    assert sweep(Wire("slink3", noisy), ALL).found[6].doubt == TWICE


def test_damage_beside_an_answer_that_does_not_come_again() -> None:
    def noisy(frame: Frame) -> Pieces:
        noise = b"\x77" if frame.control == 0 else b""
        return [(0.02, noise + answer_to(frame))] if frame.address == 6 else []

    assert sweep(Wire("slink3", noisy), ALL).found[6].doubt == ""


def test_damage_by_somebody_who_is_late() -> None:
    """The damage of a late answer is first laid to whoever was being asked; he is silent."""

    def slow(frame: Frame) -> Pieces:
        if frame.address != 20:
            return []
        answer = answer_to(frame)
        return [(0.33, b"\xff" + answer[1:] if frame.control == 0 else answer)]

    wire = Wire("slink3", slow)
    done = sweep(wire, ALL)
    assert set(done.found) == {20}
    assert not done.damaged
    assert wire.addresses()[128:] == [23, 22, 21, 20]


def test_damage_at_the_end() -> None:
    def slow(frame: Frame) -> Pieces:
        answer = answer_to(frame)
        return (
            [(1.0, b"\xff" + answer[1:] if frame.control == 0 else answer)]
            if frame.address == 126
            else []
        )

    done = sweep(Wire("slink3", slow), ALL)
    assert set(done.found) == {126}


def test_only_who_may_have_sent_it_is_asked_again() -> None:
    """Damage 1 s into the listening at the end: whoever was asked in the 1.5 s before, and not answered."""
    quick = 40 * (8 * CHARACTER + 0.1)
    wire = Wire("slink3", present(38), unasked=[(quick + 1.0, b"\xff\xff")])
    done = sweep(wire, range(40))
    assert wire.addresses()[40:] == [39, 37, 36]
    assert not done.damaged
    assert not done.counted.noisy


def test_damage_without_end_is_given_up() -> None:
    noise: Iterable[tuple[float, bytes]] = [(0.05 + 0.1 * number, b"\x77") for number in range(120)]
    wire = Wire("slink3", unasked=list(noise))
    done = sweep(wire, ALL)
    assert done.counted.noisy
    assert not done.found
    assert len(wire.asked) == 128 + MOST_SILENT


def test_a_frame_that_is_still_coming_is_not_spoken_over() -> None:
    answer = answer_to(Frame(0))
    wire = Wire(
        "slink3",
        lambda frame: [(0.095, answer[:5]), (0.12, answer[5:])] if frame.address == 0 else [],
    )
    done = sweep(wire, [0, 1])
    assert done.found[0].doubt == ""
    assert wire.asked[1].end - wire.asked[0].end == pytest.approx(0.12 + 0.002 + 8 * CHARACTER)


def test_a_line_that_never_falls_silent_does_not_stop_it() -> None:
    """Each probe is held up by the time of the longest frame at most."""
    babble = [(0.001 * number, b"\x01") for number in range(8_000)]
    wire = Wire("slink3", unasked=babble)
    sweep(wire, range(8))
    ends = [item.end for item in wire.asked]
    longest = 8 * CHARACTER + 0.1 + 255 * CHARACTER + 0.037
    assert max(later - sooner for sooner, later in pairwise(ends[:8])) < longest + 0.002


REQUEST = Frame(11, 0x0C, 0, 0x26, b"\x03\xf1\x03").encode()


def test_another_master_ends_it() -> None:
    wire = Wire("slink3", present(0, 1, 2), unasked=[(0.25, REQUEST)])
    done = sweep(wire, ALL)
    assert done.foreign == "11 #3 read typed parameter 1009:int16"
    assert len(wire.asked) == 3
    assert set(done.found) == {0, 1, 2}


def test_another_master_with_the_same_words() -> None:
    """The probe of another address than those that were asked is somebody else's."""
    wire = Wire("slink3", unasked=[(0.25, Frame(90, 0, 0, 0x23).encode())])
    assert sweep(wire, ALL).foreign == "90 #0 status word"


def test_anyway_speaks_all_the_same() -> None:
    wire = Wire("slink3", present(0, 1, 2), unasked=[(0.25, REQUEST), (0.45, REQUEST)])
    done = sweep(wire, ALL, anyway=True)
    assert done.foreign is None
    assert set(done.found) == {0, 1, 2}
    assert done.counted.strays == 2
    assert wire.addresses() == list(ALL)


def test_answers_to_a_master_that_is_not_heard_are_strays() -> None:
    wire = Wire("slink3", unasked=[(0.25, Frame(11, 0x0C, 1).encode())])
    done = sweep(wire, ALL)
    assert done.foreign is None
    assert done.counted.strays == 1
    assert not done.found


def test_what_is_left_when_it_is_broken_off() -> None:
    """Whose time is not over is asked again; whoever was found is not."""
    wire = Wire("slink3", present(3, 25, after=0.02))
    machine = begun(wire, ALL)
    port = MemoryPort(wire)
    carry_out(machine, port, until=3.0)
    assert set(machine.found) == {3, 25}
    asked = wire.addresses()
    left = machine.left
    assert machine.waiting == 128 - len(asked)
    assert left[-1] == 127
    assert set(left) | set(asked) == set(ALL)
    assert 10 < len(set(left) & set(asked)) < 18  # of the last 1.5 s
    assert not {3, 25} & set(left)

    again = Wire("slink3", present(3, 25, 27, 100))
    done = sweep(again, left, found=machine.found)
    assert set(done.found) == {3, 25, 27, 100}
    assert again.addresses() == left


def test_what_is_left_with_damage_to_look_into() -> None:
    wire = Wire("slink3", lambda frame: [(0.02, b"\x77")] if frame.address in (2, 3, 4) else [])
    machine = begun(wire, range(30))
    port = MemoryPort(wire)
    carry_out(machine, port, until=2.9)
    assert {2, 3, 4} <= set(machine.left)
    assert not machine.damaged
    carry_out(machine, port, begin=False)
    assert set(machine.damaged) == {2, 3, 4}
    assert {2, 3, 4} <= set(machine.left)


def test_bytes_with_a_port_s_mark_are_damage() -> None:
    wire = Wire("slink3")
    machine = begun(wire, [4])
    port = MemoryPort(wire)
    port.write(machine.start(0.0))
    machine.advance(b"\x41", 0.03, damaged=True)
    carry = machine.advance(b"", machine.deadline)
    assert carry == b""
    asked_alone = machine.advance(b"", machine.deadline)
    assert asked_alone == Frame(4, code=0x23).numbered(1).encode()
