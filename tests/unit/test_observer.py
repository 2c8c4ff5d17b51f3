"""What an observer makes of the frames that pass: transactions, strays, damage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.observer import Found, Observer
from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000
from multidrop.protocols.datalink import Command
from multidrop.protocols.slink3 import Frame
from multidrop.timing import LineSettings
from multidrop.transaction import Damage, Kind, Stray, Transaction

CHARACTER = slink3.LINE.character
FLEXMAX = load_profile("flexmax")


def question(number: int = 0, index: int = 8236, address: int = 1) -> Frame:
    return Frame(address, number << 2, 0, 0x26, b"\x03" + index.to_bytes(2, "little"))


def answer(number: int = 0, value: int = 5, index: int = 8236, address: int = 1) -> Frame:
    data = b"\x03" + index.to_bytes(2, "little") + value.to_bytes(2, "little")
    return Frame(address, number << 2, 1, 0, data)


def new(settings: LineSettings = slink3.LINE, *, network: bool = False) -> Observer:
    return Observer(PROTOCOLS["slink3"], settings, {1: FLEXMAX}, network=network)


def texts(found: Sequence[Found]) -> list[str]:
    """`Q text`, `S text`, `D bytes`: what was found, in short."""
    shown = []
    for item in found:
        if isinstance(item, Transaction):
            shown.append(f"T {item.meaning.text}")
        elif isinstance(item, Stray):
            shown.append(f"S {item.text}")
        else:
            shown.append(f"D {item.raw.hex()} {item.reason}")
    return shown


READ_5 = "T read index_8236 (8236) = 5"
READ_6 = "T read index_8236 (8236) = 6"
SILENT = "T read index_8236 (8236): no answer"


def test_a_question_and_its_answer() -> None:
    observer = new()
    asked, answered = question(), answer()
    assert observer.receive_data(asked.encode(), 10.0) == []
    (found,) = observer.receive_data(answered.encode(), 10.1)
    assert isinstance(found, Transaction)
    assert [heard.frame for heard in found.frames] == [asked, answered]
    assert [heard.raw for heard in found.frames] == [asked.encode(), answered.encode()]
    assert [heard.end for heard in found.frames] == [10.0, 10.1]
    assert found.frames[0].start == pytest.approx(10.0 - 11 * CHARACTER)
    assert found.frames[1].start == pytest.approx(10.1 - 13 * CHARACTER)
    assert found.answer_ms == pytest.approx(100 - 13 * CHARACTER * 1000)
    assert found.address == 1
    assert found.meaning.kind is Kind.READ
    assert found.echo is None
    assert texts([found]) == [READ_5]
    assert observer.deadline == float("inf")


def test_a_device_that_is_not_known_has_no_names() -> None:
    observer = new()
    data = question(address=7).encode() + answer(address=7).encode()
    assert texts(observer.receive_data(data, 1.0)) == ["T read 8236 = 5"]


def test_times_in_one_piece_are_worked_out_from_its_end() -> None:
    observer = new()
    (found,) = observer.receive_data(question().encode() + answer().encode() + b"\x01\x02", 10.0)
    assert isinstance(found, Transaction)
    asked, answered = found.frames
    assert answered.end == pytest.approx(10.0 - 2 * CHARACTER)
    assert asked.end == pytest.approx(answered.end - 13 * CHARACTER)
    assert found.answer_ms == 0.0
    (cut,) = observer.time_passed(11.0)
    assert isinstance(cut, Damage)
    assert cut.at == pytest.approx(10.0)


def test_a_frame_in_two_pieces_ends_with_the_second() -> None:
    observer = new()
    raw = question().encode()
    observer.receive_data(raw[:4], 10.0)
    observer.receive_data(raw[4:], 10.01)
    (found,) = observer.receive_data(answer().encode(), 10.05)
    assert isinstance(found, Transaction)
    assert found.frames[0].end == 10.01


def test_no_answer_in_time() -> None:
    observer = new()
    observer.receive_data(question().encode(), 10.0)
    assert observer.deadline == 11.5
    assert observer.time_passed(11.4) == []
    (found,) = observer.time_passed(11.5)
    assert texts([found]) == [SILENT]
    assert isinstance(found, Transaction)
    assert found.answer_ms is None
    assert len(found.frames) == 1


def test_an_answer_that_is_on_its_way_is_waited_for() -> None:
    observer = new()
    raw = answer().encode()
    observer.receive_data(question().encode(), 10.0)
    observer.receive_data(raw[:9], 11.495)
    assert observer.deadline > 11.5
    assert observer.time_passed(11.501) == []
    assert texts(observer.receive_data(raw[9:], 11.502)) == [READ_5]


def test_a_late_answer_is_a_stray() -> None:
    observer = new()
    observer.receive_data(question().encode(), 10.0)
    found = observer.receive_data(answer().encode(), 11.6)
    assert texts(found) == [SILENT, "S 1 #0 OK 8236:int16 = 5"]


def test_a_late_answer_of_a_capture_is_a_stray() -> None:
    observer = new()
    asked, answered = question(), answer()
    observer.frame(FrameReceived(asked, asked.encode()), 10.0)
    found = observer.frame(FrameReceived(answered, answered.encode()), 11.6)
    assert texts(found) == [SILENT, "S 1 #0 OK 8236:int16 = 5"]


def test_a_question_displaced_by_the_next() -> None:
    observer = new()
    observer.receive_data(question(0).encode(), 10.0)
    assert texts(observer.receive_data(question(1).encode(), 10.2)) == [SILENT]
    late = observer.receive_data(answer(0).encode(), 10.3)
    assert texts(late) == ["S 1 #0 OK 8236:int16 = 5"]
    assert texts(observer.receive_data(answer(1, 6).encode(), 10.4)) == [READ_6]


def test_a_second_master() -> None:
    """Each asks while the other waits: only the question that was asked last has an answer."""
    observer = new()
    observer.receive_data(question(0, address=1).encode(), 10.0)
    found = observer.receive_data(question(0, address=2).encode(), 10.05)
    found += observer.receive_data(answer(0, address=1).encode(), 10.1)
    found += observer.receive_data(answer(0, address=2).encode(), 10.15)
    assert texts(found) == [SILENT, "S 1 #0 OK 8236:int16 = 5", "T read 8236 = 5"]


def test_damage_between_question_and_answer() -> None:
    observer = new()
    observer.receive_data(question().encode(), 10.0)
    found = observer.receive_data(b"\xff\xfe" + answer().encode(), 10.1)
    assert texts(found) == ["D fffe no START", READ_5]
    assert isinstance(found[0], Damage)
    assert found[0].at == pytest.approx(10.1 - 13 * CHARACTER)


def test_a_byte_with_a_parity_error_is_damage() -> None:
    observer = new()
    raw = question().encode()
    observer.receive_data(raw[:3], 10.0)
    found = observer.receive_data(b"\x0b", 10.01, damaged=True)
    assert texts(found) == ["D 010100 cut short", "D 0b parity or framing error"]


def test_a_frame_cut_short_is_damage_after_a_silence() -> None:
    observer = new()
    observer.receive_data(question().encode()[:6], 10.0)
    silence = slink3.LINE.timing(network=False).silence
    assert observer.deadline == pytest.approx(10.0 + silence)
    assert observer.time_passed(10.0 + silence / 2) == []
    assert texts(observer.receive_data(answer().encode(), 10.5)) == [
        "D 0101000b0026 cut short",
        "S 1 #0 OK 8236:int16 = 5",
    ]


def test_a_long_piece_is_no_silence() -> None:
    """It took its bytes as long to come as a silence lasts."""
    observer = new()
    long = Frame(1, 0, 0, 0xABCD, bytes(200)).encode()
    observer.receive_data(long[:8], 10.0)
    assert observer.receive_data(long[8:], 10.0 + 200 * CHARACTER) == []
    assert texts(observer.finish()) == [f"T special access {bytes(200).hex(' ')}: no answer"]


def test_over_a_network_silence_is_longer() -> None:
    observer = new(network=True)
    observer.receive_data(question().encode()[:6], 10.0)
    assert observer.receive_data(question().encode()[6:], 10.2) == []
    assert texts(observer.receive_data(answer().encode(), 10.4)) == [READ_5]


def test_what_is_open_comes_out_at_the_end() -> None:
    observer = new()
    observer.receive_data(question().encode() + b"\x01", 10.0)
    assert texts(observer.finish()) == ["D 01 cut short", SILENT]
    assert observer.finish() == []


def test_damage_that_was_cut_already() -> None:
    observer = new()
    found = observer.frame(Damaged(b"\x7f", "noise"), 10.0, False)
    assert found == [Damage(b"\x7f", "noise", 10.0, False)]


# -- what this side sends, and what it hears of it -------------------------------------------


def test_what_this_side_sends_is_timed_from_its_start() -> None:
    observer = new()
    observer.receive_data(question().encode(), 10.0, sent=True)
    (found,) = observer.receive_data(answer().encode(), 10.1, sent=False)
    assert isinstance(found, Transaction)
    assert found.frames[0].start == pytest.approx(10.0)
    assert found.frames[0].end == pytest.approx(10.0 + 11 * CHARACTER)
    assert [heard.sent for heard in found.frames] == [True, False]
    assert found.answer_ms == pytest.approx(100 - (11 + 13) * CHARACTER * 1000)


def test_what_was_coming_ends_where_this_side_sends() -> None:
    observer = new()
    observer.receive_data(b"\x01\x01", 10.0, sent=False)
    found = observer.receive_data(question().encode(), 10.001, sent=True)
    assert texts(found) == ["D 0101 cut short"]


def test_an_echo_is_no_question() -> None:
    observer = new()
    raw = question().encode()
    observer.receive_data(raw, 10.0, sent=True)
    assert observer.receive_data(raw, 10.2, sent=False) == []
    (found,) = observer.receive_data(answer().encode(), 10.3, sent=False)
    assert texts([found]) == [READ_5]
    assert isinstance(found, Transaction)
    assert found.echo is not None
    assert found.echo.raw == raw
    assert len(found.frames) == 2
    assert observer.echoes == 1


def test_the_same_once_more_is_another_masters_question() -> None:
    observer = new()
    raw = question().encode()
    observer.receive_data(raw, 10.0, sent=True)
    observer.receive_data(raw, 10.02, sent=False)
    assert texts(observer.receive_data(raw, 10.1, sent=False)) == [SILENT]
    assert observer.echoes == 1


def test_a_repeated_question_is_no_echo() -> None:
    observer = new()
    raw = question().encode()
    observer.receive_data(raw, 10.0, sent=True)
    assert texts(observer.receive_data(raw, 10.5, sent=True)) == [SILENT]
    observer = new()
    observer.receive_data(raw, 10.0)
    assert texts(observer.receive_data(raw, 10.1)) == [SILENT]
    assert observer.echoes == 0


def test_a_listener_takes_what_overlaps_its_question_for_its_echo() -> None:
    observer = new()
    raw = question().encode()
    observer.receive_data(raw, 10.0)
    assert observer.receive_data(raw, 10.005) == []
    assert observer.echoes == 1
    assert texts(observer.receive_data(answer().encode(), 10.1)) == [READ_5]


def test_an_answer_that_this_side_sends_answers_what_it_heard() -> None:
    """A simulator's side of the line."""
    observer = new()
    observer.receive_data(question().encode(), 10.0, sent=False)
    assert texts(observer.receive_data(answer().encode(), 10.1, sent=True)) == [READ_5]


def test_a_broadcast_has_no_answer() -> None:
    observer = new()
    broadcast = Frame(255, 0, 0, 0x27, bytes.fromhex("03 2C 20 07 00"))
    observer.receive_data(broadcast.encode(), 10.0)
    found = observer.receive_data(question().encode(), 10.2)
    assert texts(found) == ["T broadcast write 8236 := 7"]


def test_an_echo_that_comes_too_late_is_a_question() -> None:
    observer = new()
    observer.receive_data(question().encode(), 10.0, sent=True)
    found = observer.receive_data(question().encode(), 12.0, sent=False)
    assert texts(found) == [SILENT]
    assert observer.echoes == 0


def test_a_stray_that_this_side_repeats_is_no_echo() -> None:
    observer = new()
    for _ in range(2):
        assert texts(observer.receive_data(answer().encode(), 10.0, sent=True)) == [
            "S 1 #0 OK 8236:int16 = 5"
        ]


# -- Datalink: three frames, and more ----------------------------------------------------------

CHANGE = datalink.Frame(Command.CHANGE, 3, 0x72F, 3, b"\x40\x00\x01")
ECHOED = datalink.Frame(Command.RESPONSE, 3, 0x72F, 3, b"\x40\x00\x01")
ACKNOWLEDGE = datalink.Frame(Command.ACKNOWLEDGE, 3)
WRITTEN = "T write loop0_setpoint (C101) := 1 EU"


def instrument() -> Observer:
    profiles = {3: load_profile("53mc5000")}
    return Observer(PROTOCOLS["datalink"], datalink.LINE, profiles)


def test_a_change_its_echo_and_its_acknowledge_are_one_write() -> None:
    observer = instrument()
    assert observer.receive_data(CHANGE.encode(), 10.0) == []
    assert observer.receive_data(ECHOED.encode(), 10.1) == []
    assert observer.deadline == 11.6
    (found,) = observer.receive_data(ACKNOWLEDGE.encode(), 10.15)
    assert texts([found]) == [f"{WRITTEN}: acknowledged"]
    assert isinstance(found, Transaction)
    assert len(found.frames) == 3
    assert found.answer_ms == pytest.approx(100 - 9 * datalink.LINE.character * 1000)


def test_a_change_that_is_not_acknowledged() -> None:
    observer = instrument()
    observer.receive_data(CHANGE.encode() + ECHOED.encode(), 10.0)
    found = observer.receive_data(CHANGE.encode(), 10.3)
    found += observer.receive_data(ACKNOWLEDGE.encode(), 10.4)
    found += observer.receive_data(ACKNOWLEDGE.encode(), 10.5)
    assert texts(found) == [
        f"{WRITTEN}: not acknowledged",
        f"{WRITTEN}: acknowledged, its echo was not heard",
        "S 3 acknowledge",
    ]
    second = found[1]
    assert isinstance(second, Transaction)
    assert second.answer_ms is None


def test_the_echo_of_an_acknowledge_belongs_to_nothing() -> None:
    observer = instrument()
    observer.receive_data(CHANGE.encode(), 10.0, sent=True)
    observer.receive_data(CHANGE.encode(), 10.02, sent=False)
    observer.receive_data(ECHOED.encode(), 10.05, sent=False)
    found = observer.receive_data(ACKNOWLEDGE.encode(), 10.06, sent=True)
    assert texts(found) == [f"{WRITTEN}: acknowledged"]
    assert observer.receive_data(ACKNOWLEDGE.encode(), 10.07, sent=False) == []
    assert observer.echoes == 2
    observer.receive_data(CHANGE.encode(), 11.0, sent=True)
    (unheard,) = observer.finish()
    assert isinstance(unheard, Transaction)
    assert unheard.echo is None


# -- Ultra3000: frames that do not show who sent them ------------------------------------------

ACTION = ultra3000.Frame(0, 0x06F, 1).encode()
DONE = "T do reset_faults (0x06F): OK"
UNDONE = "T do reset_faults (0x06F): no answer"


def drive() -> Observer:
    return Observer(PROTOCOLS["ultra3000"], ultra3000.LINE, {0: load_profile("ultra3000")})


def test_an_action_is_answered_by_itself() -> None:
    observer = drive()
    assert texts(observer.receive_data(ACTION + ACTION, 10.0)) == [DONE]
    assert observer.receive_data(ACTION, 11.0) == []
    assert texts(observer.receive_data(ACTION, 11.001)) == [DONE]  # pieces may come late
    assert observer.echoes == 0


def test_an_action_alone_may_be_a_late_answer() -> None:
    observer = drive()
    observer.receive_data(ACTION, 10.0)
    assert texts(observer.finish()) == ["S 0 06F write working"]


def test_an_action_that_this_side_sent_is_no_answer() -> None:
    observer = drive()
    observer.receive_data(ACTION, 10.0, sent=True)
    assert texts(observer.receive_data(ACTION, 10.3, sent=True)) == [UNDONE]
    assert texts(observer.finish()) == [UNDONE]


def test_the_first_copy_on_a_line_that_hears_itself_is_the_echo() -> None:
    observer = drive()
    read = ultra3000.Frame(0, 0x075).encode()
    observer.receive_data(read, 10.0, sent=True)
    observer.receive_data(read, 10.02, sent=False)
    observer.receive_data(ultra3000.Frame(0, 0x075, 0, "FF").encode(), 10.03, sent=False)
    observer.receive_data(ACTION, 11.0, sent=True)
    assert observer.receive_data(ACTION, 11.02, sent=False) == []
    assert texts(observer.receive_data(ACTION, 11.03, sent=False)) == [DONE]
    assert observer.echoes == 2


def test_a_copy_is_an_answer_where_no_echo_was_heard() -> None:
    observer = drive()
    observer.receive_data(ACTION, 11.0, sent=True)
    assert texts(observer.receive_data(ACTION, 11.02, sent=False)) == [DONE]


def test_a_copy_that_began_too_early_is_an_echo() -> None:
    observer = drive()
    observer.receive_data(ACTION, 11.0, sent=True)
    end = 11.0 + len(ACTION) * ultra3000.LINE.character
    assert observer.receive_data(ACTION, end, sent=False) == []
    assert texts(observer.receive_data(ACTION, end + 0.01, sent=False)) == [DONE]


def test_an_array_is_read_by_its_index() -> None:
    observer = drive()
    observer.receive_data(ultra3000.Frame(0, 0x02B, 0, "07").encode(), 10.0)
    value = ultra3000.Frame(0, 0x02B, 0, "00000010").encode()
    expected = "T read preset_position_acceleration (0x02B.7) = 16 counts/s^2"
    assert texts(observer.receive_data(value, 10.1)) == [expected]
    assert texts(observer.receive_data(value, 10.2)) == ["S 0 02B read working = 00000010"]


def test_setpoints_that_nobody_answers() -> None:
    observer = drive()
    first, second = (ultra3000.Frame(0, 0x06D, 1, f"{value:08X}") for value in (1, 2))
    observer.receive_data(first.encode(), 10.0)
    found = observer.receive_data(second.encode(), 10.3)
    assert texts(found) == ["T write setpoint_velocity (0x06D) := 1 counts/s: no answer"]


def test_a_skipped_line_feed_moves_no_time() -> None:
    observer = drive()
    observer.receive_data(ACTION + b"\n", 10.0, sent=False)
    assert texts(observer.time_passed(12.0)) == ["S 0 06F write working"]
    observer.receive_data(ultra3000.Frame(0, 0x075).encode(), 13.0)
    (found,) = observer.receive_data(ultra3000.Frame(0, 0x075, 0, "00").encode(), 13.5)
    assert isinstance(found, Transaction)
    assert found.frames[1].end == 13.5


# -- profiles ----------------------------------------------------------------------------------


def test_a_profile_of_another_protocol_is_refused() -> None:
    with pytest.raises(UsageError, match="device 3: profile ultra3000 is of ultra3000"):
        Observer(PROTOCOLS["slink3"], slink3.LINE, {3: load_profile("ultra3000")})


def test_a_profile_whose_points_cannot_be_said_is_refused() -> None:
    point = replace(FLEXMAX.points["address"], at="mem/0x1000/9")
    broken = replace(FLEXMAX, points={"address": point})
    with pytest.raises(UsageError, match="mem/0x1000/9"):
        Observer(PROTOCOLS["slink3"], slink3.LINE, {1: broken})
