"""One write of a Datalink point, and what is known of it when it is over.

Until its Acknowledge a change does nothing in the instrument: it may be sent
again, and where it fails, it is certain that nothing was changed. After it,
only the read-back tells.
"""

from __future__ import annotations

from dataclasses import replace

from multidrop.conversation import Conversation, Delay
from multidrop.errors import Error, NoReply, NotApplied, OutcomeUnknown, ProtocolError
from multidrop.points import Value, shown_value
from multidrop.protocols.datalink.frame import Frame
from multidrop.protocols.datalink.master import Master, outcome
from multidrop.protocols.datalink.points import DataPoint
from multidrop.writing import Outcome, Written


def write_point(
    master: Master,
    point: DataPoint,
    asked: Value,
    change: Frame,
    settle: float,
    *,
    verify: bool = True,
) -> Conversation[Frame, Written]:
    """Carry out the `change` that brings `point` to `asked`; `settle` s are for the read-back.

    Raises `NoReply` where the old value cannot be read: then nothing was
    written. Nothing else is raised.
    """
    before = yield from master.memory_of(change)
    record = Written(point, asked, Outcome.UNKNOWN, point.sample(before))
    try:
        delay = yield from master.carry_out(change)
    except NotApplied as late:  # the change is dropped already, and its memory read
        return _not_acknowledged(record, point, late, late.found)
    except (NoReply, ProtocolError) as failure:
        return _not_acknowledged(record, point, failure, (yield from master.drop(change)))
    if not verify:
        return replace(record, outcome=Outcome.UNVERIFIED)
    try:
        found = yield from master.confirm(change, settle)
    except NoReply as failure:
        return _lost(record, failure)
    record = replace(record, found=point.sample(found), outcome=outcome(change, before, found))
    return _judged(record, settle, delay)


def _not_acknowledged(record: Written, point: DataPoint, error: Error, found: object) -> Written:
    """Certainly nothing was changed; `found` are the bytes of memory, None where unread."""
    sample = point.sample(found) if isinstance(found, bytes) else None
    return replace(record, outcome=Outcome.NOT_APPLIED, found=sample, error=error)


def _lost(record: Written, failure: NoReply) -> Written:
    unknown = OutcomeUnknown(
        f"{record.point}: the change to {shown_value(record.asked)} was acknowledged"
        f" and could not be read back ({failure})",
        step="the read-back",
    )
    return replace(record, error=unknown)


def _judged(record: Written, settle: float, delay: Delay) -> Written:
    """The record with the error that its outcome stands for."""
    if record.outcome is Outcome.CONFIRMED:
        return record
    assert record.old is not None
    assert record.found is not None
    asked, found = shown_value(record.asked), record.found.value
    if record.outcome is Outcome.NOT_APPLIED:
        error: Error = NotApplied(
            f"{record.point}: the change to {asked} was acknowledged{_after_echo(delay)},"
            f" and after {settle:g} s the old value {shown_value(found)} is still read back",
            found=found,
        )
    else:
        error = OutcomeUnknown(
            f"{record.point}: {asked} was written, {shown_value(found)} is read back,"
            f" and {shown_value(record.old.value)} was there before",
            step="the read-back",
        )
    return replace(record, error=error)


def _after_echo(delay: Delay) -> str:
    """How late, where somebody measured it: an instrument may have dropped the change by then."""
    return "" if delay.seconds is None else f" {delay.seconds * 1000:.0f} ms after its echo"
