"""The write rule, branch by branch, with a protocol whose frames are words.

The dialogues have the same branches with SLINK3's bytes; here is what SLINK3 cannot show.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from words import Word

from multidrop.conversation import Ask, Conversation
from multidrop.errors import DeviceError, NoReply, OutcomeUnknown, ProtocolError, UsageError
from multidrop.points import Point, Role, Sample
from multidrop.profile import PointDescription
from multidrop.writing import Outcome, Written, write_once

Answer = str | Exception


def write(
    answers: list[Answer],
    role: Role = Role.SETTING,
    *,
    verify: bool = True,
    wanted: Callable[[Sample], bytes] = lambda sample: b"new",
) -> tuple[Written, list[str]]:
    """What comes of a write whose steps are answered so, and the steps."""
    point = Point("p", description=PointDescription("p", "p", role))

    def read() -> Conversation[Word, Sample]:
        answer = yield Ask(Word("read"), repeatable=True)
        return Sample(answer.content, "string", answer.content.encode())

    def send(old: Sample | None) -> Conversation[Word, bool]:
        answer = yield Ask(Word("write"))
        return answer.content == "submitted"

    conversation = write_once(point, "new", read, send, wanted, verify=verify)
    steps: list[str] = []
    step: Any = next(conversation)
    try:
        for answer in answers:
            steps.append(step.frame.content)
            if isinstance(answer, Exception):
                step = conversation.throw(answer)
            else:
                step = conversation.send(Word(answer))
    except StopIteration as stop:
        assert len(steps) == len(answers), "it ended before the last answer"
        return stop.value, steps
    raise AssertionError(f"after the last answer it asks {step}")


SILENT = NoReply(3)
REFUSED = DeviceError(1, "no")
BROKEN = ProtocolError("broken")


@pytest.mark.parametrize(
    ("answers", "outcome", "error"),
    [
        (["old", "ok", "new"], Outcome.CONFIRMED, None),
        (["old", "ok", "other"], Outcome.DIFFERS, "NotApplied"),
        (["old", "ok", SILENT], Outcome.UNVERIFIED, "NoReply"),
        (["old", "ok", BROKEN], Outcome.UNVERIFIED, "ProtocolError"),
        (["old", "ok", REFUSED], Outcome.UNVERIFIED, "DeviceError"),
        (["old", REFUSED], Outcome.NOT_APPLIED, "DeviceError"),
        (["old", SILENT, "new"], Outcome.CONFIRMED, None),
        (["old", SILENT, "other"], Outcome.UNKNOWN, "OutcomeUnknown"),
        (["old", SILENT, SILENT], Outcome.UNKNOWN, "OutcomeUnknown"),
        (["old", SILENT, BROKEN], Outcome.UNKNOWN, "OutcomeUnknown"),
        (["old", SILENT, REFUSED], Outcome.UNKNOWN, "OutcomeUnknown"),
        (["old", SILENT, "old", "ok", "new"], Outcome.CONFIRMED, None),
        (["old", SILENT, "old", SILENT, "new"], Outcome.CONFIRMED, None),
        (["old", SILENT, "old", SILENT, "old"], Outcome.UNKNOWN, "OutcomeUnknown"),
        (["old", BROKEN, "new"], Outcome.CONFIRMED, None),
        (["old", BROKEN, "old", "ok", "new"], Outcome.CONFIRMED, None),
        (["old", "submitted", "new"], Outcome.CONFIRMED, None),
        (["old", "submitted", "old"], Outcome.UNKNOWN, "OutcomeUnknown"),
        (["old", "submitted", SILENT], Outcome.UNKNOWN, "OutcomeUnknown"),
        ([REFUSED, "ok", "new"], Outcome.CONFIRMED, None),
        ([REFUSED, "ok", REFUSED], Outcome.UNVERIFIED, None),
        ([REFUSED, SILENT, "old"], Outcome.UNKNOWN, "OutcomeUnknown"),
        (["new", "ok", "new"], Outcome.CONFIRMED, None),
        (["new", SILENT, "new"], Outcome.CONFIRMED, None),
    ],
)
def test_a_setting(answers: list[Answer], outcome: Outcome, error: str | None) -> None:
    record, steps = write(answers)
    assert record.outcome is outcome
    assert (type(record.error).__name__ if record.error else None) == error
    assert steps == ["read", "write", "read", "write", "read"][: len(answers)]


@pytest.mark.parametrize("role", [role for role in Role if role is not Role.SETTING])
def test_everything_else_is_never_sent_again(role: Role) -> None:
    record, _ = write(["old", SILENT, "old"], role)
    assert record.outcome is Outcome.UNKNOWN
    assert record.found is not None
    assert record.found.value == "old"


@pytest.mark.parametrize("failure", [SILENT, BROKEN])
def test_nothing_is_written_without_an_old_value(failure: Exception) -> None:
    with pytest.raises(type(failure)):
        write([failure])


def test_nothing_is_written_that_does_not_fit_what_was_read() -> None:
    def refuse(sample: Sample) -> bytes:
        raise UsageError("it does not fit")

    with pytest.raises(UsageError):
        write(["old"], wanted=refuse)


def test_a_read_back_of_a_type_that_the_value_does_not_fit_raises_nothing() -> None:
    def wanted(sample: Sample) -> bytes:
        if sample.value == "other":
            raise UsageError("it does not fit")
        return b"new"

    answered, _ = write(["old", "ok", "other"], wanted=wanted)
    silent, _ = write(["old", SILENT, "other"], wanted=wanted)
    assert (answered.outcome, silent.outcome) == (Outcome.DIFFERS, Outcome.UNKNOWN)


@pytest.mark.parametrize(
    ("answer", "outcome"),
    [
        ("ok", Outcome.UNVERIFIED),
        ("submitted", Outcome.UNKNOWN),
        (SILENT, Outcome.UNKNOWN),
        (REFUSED, Outcome.NOT_APPLIED),
    ],
)
def test_without_a_read_back(answer: Answer, outcome: Outcome) -> None:
    record, steps = write(["old", answer], verify=False)
    assert record.outcome is outcome
    assert record.found is None
    assert steps == ["read", "write"]


def test_what_was_found_before_the_second_try_is_forgotten() -> None:
    record, _ = write(["old", SILENT, "old", "ok", SILENT])
    assert record.outcome is Outcome.UNVERIFIED
    assert record.found is None


def test_the_step_says_where_it_was_lost() -> None:
    unanswered, _ = write(["old", SILENT, "other"])
    submitted, _ = write(["old", "submitted", "other"])
    assert isinstance(unanswered.error, OutcomeUnknown)
    assert isinstance(submitted.error, OutcomeUnknown)
    assert unanswered.error.step == "the answer to the write"
    assert submitted.error.step == "submitted"
