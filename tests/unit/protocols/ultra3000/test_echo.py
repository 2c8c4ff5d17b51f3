"""Local echo: the right answer to an action is the request over again, and must not be believed twice."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.conversation import Conversation
from multidrop.errors import NoReply, OutcomeUnknown
from multidrop.events import FrameReceived
from multidrop.exchange import Exchange
from multidrop.protocols.ultra3000 import LINE, Frame
from multidrop.protocols.ultra3000.device import Ultra3000Device
from multidrop.session import Session
from multidrop.writing import Outcome
from unit.protocols.ultra3000.wire import PRODUCT, Wire

DRIVE = Ultra3000Device(0, load_profile("ultra3000"))
NO_DRIVE: dict[str, None] = {"0000": None}
SILENT_AFTERWARDS = {"0000": "0A000001"}

ACTIONS: dict[str, tuple[str, Callable[[], Conversation[Frame, Any]]]] = {
    "clear faults": ("06F1", DRIVE.clear_faults),
    "reset comm": ("10A1", DRIVE.reset_comm),
    "an action by name": ("071" + "1", DRIVE.prepare_action("define_home")),
    "an action as raw": ("0CD1", DRIVE.prepare_raw("0CD1")),
}
each_action = pytest.mark.parametrize(("body", "act"), ACTIONS.values(), ids=ACTIONS)


@each_action
@pytest.mark.parametrize("hears_itself", [True, False])
def test_nothing_is_sent_where_the_learning_read_is_not_answered(
    body: str, act: Callable[[], Conversation[Frame, Any]], hears_itself: bool
) -> None:
    wire = Wire(NO_DRIVE, echo=None, hears_itself=hears_itself, keeps_time=None)
    with pytest.raises(NoReply, match=r"nothing was sent but the read of 000 .* in 3 attempts"):
        wire.run(act())
    assert wire.sent == ["0000"] * 3


@each_action
def test_local_echo_that_was_told_and_no_drive(
    body: str, act: Callable[[], Conversation[Frame, Any]]
) -> None:
    wire = Wire(NO_DRIVE, echo=True, hears_itself=True, keeps_time=None)
    with pytest.raises(OutcomeUnknown, match="was sent and was not answered"):
        wire.run(act())
    assert wire.sent == [body]


@each_action
@pytest.mark.parametrize("hears_itself", [True, False])
def test_a_drive_that_falls_silent_after_the_learning_read(
    body: str, act: Callable[[], Conversation[Frame, Any]], hears_itself: bool
) -> None:
    wire = Wire(SILENT_AFTERWARDS, echo=None, hears_itself=hears_itself, keeps_time=None)
    with pytest.raises(OutcomeUnknown, match="was sent and was not answered"):
        wire.run(act())
    assert wire.sent == ["0000", body]


@each_action
@pytest.mark.parametrize("echo", [None, True])
def test_local_echo_and_a_drive(
    body: str, act: Callable[[], Conversation[Frame, Any]], echo: bool | None
) -> None:
    afterwards = {body: "", "0740": "00000000", "0750": "FF"}
    wire = Wire(afterwards, echo=echo, hears_itself=True, keeps_time=None)
    wire.run(act())
    learned = ["0000"] if echo is None else []
    assert wire.sent[: len(learned) + 1] == [*learned, body]
    wire.run(act())
    assert wire.sent.count("0000") == len(learned)


@each_action
@pytest.mark.parametrize("echo", [None, False])
def test_no_echo_and_a_drive(
    body: str, act: Callable[[], Conversation[Frame, Any]], echo: bool | None
) -> None:
    wire = Wire({body: "", "0740": "00000000", "0750": "FF"}, echo=echo, keeps_time=None)
    wire.run(act())
    assert wire.sent[:2] == ["0000", body]


@each_action
def test_a_line_that_is_said_to_have_no_echo_has_one_and_no_drive(
    body: str, act: Callable[[], Conversation[Frame, Any]]
) -> None:
    wire = Wire(NO_DRIVE, echo=False, hears_itself=True, keeps_time=None)
    with pytest.raises(NoReply, match="nothing was sent"):
        wire.run(act())


@each_action
def test_what_is_heard_counts_more_than_what_was_said_of_the_line(
    body: str, act: Callable[[], Conversation[Frame, Any]]
) -> None:
    wire = Wire(SILENT_AFTERWARDS, echo=False, hears_itself=True, keeps_time=None)
    with pytest.raises(OutcomeUnknown, match="was sent and was not answered"):
        wire.run(act())
    assert wire.session.echo is True


def test_a_copy_that_came_before_the_request_can_have_left_is_no_answer() -> None:
    session: Session[Frame] = Session(LINE.decoder(), LINE.timing(network=False), echo=False)
    session.keeps_time = True
    exchange = Exchange(DRIVE.reset_comm(), session)
    raw = exchange.start(100.0)
    left = 100.0 + len(raw) * LINE.character
    exchange.advance(raw, left - 0.0001)
    assert not exchange.done
    exchange.advance(b"", exchange.deadline)
    with pytest.raises(OutcomeUnknown):
        exchange.result()
    again = Exchange(DRIVE.reset_comm(), session)
    raw = again.start(200.0)
    again.advance(raw, 200.0 + len(raw) * LINE.character)
    assert again.done
    assert again.result().fields == {"reset": True}


def test_a_simulated_line_answers_sooner_than_its_baud_rate_allows() -> None:
    session: Session[Frame] = Session(LINE.decoder(), LINE.timing(network=False))
    exchange = Exchange(DRIVE.reset_comm(), session)
    exchange.start(100.0)
    raw = exchange.advance(Frame(0, 0, 0, "0A000001").encode(), 100.0)
    exchange.advance(raw, 100.0)
    assert exchange.done
    assert exchange.result().fields == {"reset": True}


def test_damage_in_the_learning_read_leaves_the_echo_unknown() -> None:
    """An echo that was hit looks like no echo, so the read is asked again."""
    answer = Frame(0, 0, 0, "0A000001").encode()
    hit = b":0000\x80056\r" + answer
    wire = Wire({"0000": [hit, hit, answer], "10A1": ""}, echo=None, keeps_time=None)
    wire.run(DRIVE.reset_comm())
    assert wire.sent == ["0000", "0000", "0000", "10A1"]
    wire = Wire({"0000": hit}, echo=None, keeps_time=None)
    with pytest.raises(NoReply, match=r"nothing was sent .* damage hides whether the line has"):
        wire.run(DRIVE.reset_comm())
    assert wire.sent == ["0000"] * 3


@pytest.mark.parametrize(
    ("hears_itself", "answer", "outcome"),
    [(True, "", Outcome.CONFIRMED), (True, None, Outcome.UNKNOWN), (False, "", Outcome.CONFIRMED)],
)
def test_a_save_on_a_line_with_echo(
    hears_itself: bool, answer: str | None, outcome: Outcome
) -> None:
    after = "0280" if outcome is Outcome.CONFIRMED else "0200"
    wire = Wire(
        {"0110": "0280", "0112": ["0200", after], "0115": answer},
        echo=None,
        hears_itself=hears_itself,
        keeps_time=None,
    )
    (record,) = wire.run(DRIVE.copy(DRIVE.prepare_copy("kp", save=True)))
    assert record.outcome is outcome
    assert wire.sent[0] == "0000"
    assert wire.sent.count("0115") == 1


def test_a_write_begins_with_the_learning_read() -> None:
    wire = Wire({"0110": ["0200", "0280"], "01110280": ""}, echo=None, keeps_time=None)
    wire.run(DRIVE.write(DRIVE.prepare_write("kp", 5)))
    assert wire.sent == ["0000", "0110", "01110280", "0110"]
    wire = Wire(NO_DRIVE, echo=None, hears_itself=True, keeps_time=None)
    with pytest.raises(NoReply):
        wire.run(DRIVE.write(DRIVE.prepare_write("kp", 5)))
    assert wire.sent == ["0000"] * 3


def test_an_element_whose_value_is_its_index_is_read_on_a_line_with_echo() -> None:
    for hears_itself in (True, False):
        wire = Wire({"0B6001": "01"}, echo=None, hears_itself=hears_itself, keeps_time=None)
        sample = wire.run(DRIVE.read(DRIVE.point("index_termination.1")))
        assert sample.value == 1
        assert wire.session.echo is hears_itself
    wire = Wire({"0B6001": None}, echo=True, hears_itself=True)
    with pytest.raises(NoReply):
        wire.run(DRIVE.read(DRIVE.point("index_termination.1")))


def test_the_echo_of_a_broadcast_is_no_foreign_frame() -> None:
    wire = Wire(PRODUCT, hears_itself=True, echo=True)
    wire.run(DRIVE.master.broadcast_write(0x06B, "00"))
    events = wire.session.decoder.receive_data(Frame(255, 0x06B, 1, "00").encode())
    wire.session.count_strays(events)
    assert isinstance(events[0], FrameReceived)
    assert (wire.session.counters.echoes, wire.session.counters.foreign) == (1, 0)
