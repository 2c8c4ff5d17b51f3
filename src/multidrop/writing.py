"""Writes are sent once: the rule that every write of every protocol goes through.

Asking twice may act twice: a control word restarts a motor, a non-volatile write
wears memory. So the old value is read first; then the write goes out once; when
no answer comes, the point is read back. As wanted: confirmed. The old value, for
a setting: one more try. Anything else is an unknown outcome.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TypeVar

from multidrop import conversation as steps
from multidrop.conversation import Conversation
from multidrop.errors import (
    DeviceError,
    Error,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    ProtocolError,
    UsageError,
)
from multidrop.points import Point, Role, Sample, Value, shown_value

FrameT = TypeVar("FrameT", bound=steps.Frame)


class Outcome(StrEnum):
    """What is known of a write when it is over."""

    CONFIRMED = "confirmed"  # the read-back shows the value
    UNVERIFIED = "unverified"  # the device said OK, and nobody read back
    DIFFERS = "differs"  # the device said OK, and the read-back shows another value
    NOT_APPLIED = "not-applied"  # it went out, and was certainly not carried out
    UNKNOWN = "unknown"
    NOT_SENT = "not-sent"


@dataclass(frozen=True, slots=True)
class Written:
    """The record of one write. `old` and `found` are None where they could not be read."""

    point: Point
    asked: Value
    outcome: Outcome
    old: Sample | None = None
    found: Sample | None = None
    error: Error | None = None


ANSWER = "the answer to the write"
"""The step at which a write is lost that nobody answered."""

Send = Callable[[Sample | None], "Conversation[FrameT, bool]"]
"""Sends the write, given the old value; returns whether the device answered "submitted" only."""


def write_once(
    point: Point,
    asked: Value,
    read: Callable[[], Conversation[FrameT, Sample]],
    send: Send[FrameT],
    wanted: Callable[[Sample], bytes],
    *,
    verify: bool = True,
) -> Conversation[FrameT, Written]:
    """Carry out a write and say what is known of it. Never raises once the write went out.

    `wanted` gives the bytes that the read-back must show, for a sample of the
    point's type. Raises `NoReply` when the old value cannot be read, and
    `UsageError` when the value does not fit the type that a read has shown:
    then nothing was written.
    """
    try:
        old: Sample | None = yield from read()
    except DeviceError:
        old = None  # a write-only point
    if old is not None:
        wanted(old)
    record = Written(point, asked, Outcome.UNKNOWN, old)
    for last_try in (False, True) if point.role is Role.SETTING else (True,):
        record, silent = yield from _send(replace(record, found=None), send)
        if not verify or (record.error is not None and not silent):
            return record
        record = yield from _read_back(record, read, wanted, silent)
        unchanged = record.found is not None and old is not None and record.found.raw == old.raw
        if last_try or not unchanged or not _unanswered(record):
            return record
    raise AssertionError("the last try returns")


def _send(record: Written, send: Send[FrameT]) -> Conversation[FrameT, tuple[Written, bool]]:
    """Send it; returns the record, and whether the answer says nothing of the outcome."""
    try:
        submitted = yield from send(record.old)
    except DeviceError as refusal:
        return replace(record, outcome=Outcome.NOT_APPLIED, error=refusal), False
    except (NoReply, ProtocolError) as failure:
        what = "did not come" if isinstance(failure, NoReply) else "cannot be believed"
        unknown = OutcomeUnknown(
            f"{record.point}: the write of {shown_value(record.asked)} went out and its answer {what} ({failure})",
            step=ANSWER,
        )
        return replace(record, outcome=Outcome.UNKNOWN, error=unknown), True
    if submitted:
        unknown = OutcomeUnknown(
            f"{record.point}: the device took the write of {shown_value(record.asked)} and cannot say whether it was done",
            step="submitted",
        )
        return replace(record, outcome=Outcome.UNKNOWN, error=unknown), True
    return replace(record, outcome=Outcome.UNVERIFIED, error=None), False


def _unanswered(record: Written) -> bool:
    return isinstance(record.error, OutcomeUnknown) and record.error.step == ANSWER


def _as_wanted(found: Sample, wanted: Callable[[Sample], bytes]) -> bool:
    try:
        return found.raw == wanted(found)
    except UsageError:  # it is read back as another type, which the value does not fit
        return False


def _read_back(
    record: Written,
    read: Callable[[], Conversation[FrameT, Sample]],
    wanted: Callable[[Sample], bytes],
    silent: bool,
) -> Conversation[FrameT, Written]:
    try:
        found = yield from read()
    except DeviceError as refusal:  # write-only: the device's OK is all there is
        return record if silent or record.old is None else replace(record, error=refusal)
    except (NoReply, ProtocolError) as failure:
        return record if silent else replace(record, error=failure)
    if _as_wanted(found, wanted):
        return replace(record, found=found, outcome=Outcome.CONFIRMED, error=None)
    if silent:
        return replace(record, found=found)
    value = record.point.physical(found.value)
    differs = NotApplied(
        f"{record.point}: {shown_value(record.asked)} was written, {shown_value(value)} is read back",
        found=value,
    )
    return replace(record, found=found, outcome=Outcome.DIFFERS, error=differs)
