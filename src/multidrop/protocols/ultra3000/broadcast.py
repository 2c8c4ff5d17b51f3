"""A write to every drive at once. No drive answers it; only the read-back of the point shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from multidrop.conversation import Conversation, Wait
from multidrop.device import Received, Write
from multidrop.errors import (
    DeviceError,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    ProtocolError,
    UsageError,
)
from multidrop.points import Role, Sample, shown_value
from multidrop.profile import Profile
from multidrop.protocols.ultra3000.device import Ultra3000Device, broadcast_of
from multidrop.protocols.ultra3000.frame import Frame
from multidrop.protocols.ultra3000.points import ParameterPoint, View
from multidrop.protocols.ultra3000.values import ACTION, HEX
from multidrop.writing import Outcome, Written

REST = 0.1
"""s that the line rests after a broadcast, so that every drive has carried it out."""


def prepare_broadcast(
    profile: Profile,
    points: Iterable[tuple[str, str]],
    addresses: Iterable[int],
    options: Mapping[str, str],
    *,
    force: bool = False,
    keep_going: bool = False,
) -> Callable[[], Conversation[Frame, list[Received]]]:
    """Check the whole broadcast; returns the conversation that carries it out."""
    broadcast = broadcast_of(options)
    drives = [Ultra3000Device(address, profile, broadcast) for address in addresses]
    speaker = Ultra3000Device(0, profile, broadcast)
    writes = [_plan(speaker, text, value, force) for text, value in points]

    def converse() -> Conversation[Frame, list[Received]]:
        before = {}
        for drive in drives:
            before[drive.address] = yield from _before(drive, writes, keep_going)
        for write in writes:
            point = _point(write)
            digits = speaker.digits(write, None)
            yield from speaker.master.broadcast_write(
                point.parameter, digits, point.element, non_volatile=point.view is View.NV
            )
        yield Wait(REST)
        found = []
        for drive in drives:
            found.append((yield from _after(drive, writes, before[drive.address])))
        return found

    return converse


def _point(write: Write) -> ParameterPoint:
    assert isinstance(write.point, ParameterPoint)
    return write.point


def _plan(speaker: Ultra3000Device, text: str, value: str, force: bool) -> Write:
    write = speaker.prepare_write(text, value, force=force)
    point = _point(write)
    if point.kind is HEX and not speaker.digits(write, None):
        raise UsageError(f"{point} needs all its digits to be broadcast, as in 0x0001")
    if point.role in (Role.COMMAND, Role.COMMUNICATION) and not force:
        raise UsageError(
            f"{point} has role {point.role.value}: every drive would act on it; --force broadcasts it"
        )
    return write


def _before(
    drive: Ultra3000Device, writes: list[Write], keep_going: bool
) -> Conversation[Frame, list[Sample | None] | None]:
    """The old values, None where a drive does not give one; None in all for a silent drive."""
    old: list[Sample | None] = []
    try:
        yield from drive.master.learn_echo()
        for write in writes:
            old.append((yield from _sample_or_none(drive, _point(write))))
    except NoReply as failure:
        if not keep_going:
            raise NoReply(
                failure.attempts,
                failure.damaged,
                failure.heard,
                because=f"drive {drive.address} did not answer, so nothing was broadcast: no reply",
            ) from failure
        return None
    return old


def _sample_or_none(
    drive: Ultra3000Device, point: ParameterPoint
) -> Conversation[Frame, Sample | None]:
    if point.kind is ACTION:
        return None
    try:
        return (yield from drive.sample(point))
    except (DeviceError, ProtocolError):
        return None


def _after(
    drive: Ultra3000Device, writes: list[Write], before: list[Sample | None] | None
) -> Conversation[Frame, Received]:
    note = "it was silent before the broadcast" if before is None else ""
    written = []
    for write, old in zip(writes, before or [None] * len(writes), strict=True):
        written.append((yield from _read_back(drive, write, old)))
    outcomes = {record.outcome for record in written}
    applied = (
        None if outcomes - {Outcome.CONFIRMED, Outcome.DIFFERS} else outcomes <= {Outcome.CONFIRMED}
    )
    return Received(drive.address, None, applied, note, tuple(written))


def _read_back(
    drive: Ultra3000Device, write: Write, old: Sample | None
) -> Conversation[Frame, Written]:
    point, asked = _point(write), drive.asked(write)
    if point.kind is ACTION:
        return Written(point, asked, Outcome.UNVERIFIED)
    try:
        found = yield from drive.sample(point)
    except (NoReply, DeviceError, ProtocolError) as failure:
        unknown = OutcomeUnknown(f"drive {drive.address}, {point}: {failure}", step="the read-back")
        return Written(point, asked, Outcome.UNKNOWN, old, None, unknown)
    if found.raw == drive.wanted(write, found):
        return Written(point, asked, Outcome.CONFIRMED, old, found)
    differs = NotApplied(
        f"drive {drive.address}, {point}: {shown_value(asked)} was broadcast, "
        f"{shown_value(point.physical(found.value))} is read back",
        found=found.value,
    )
    return Written(point, asked, Outcome.DIFFERS, old, found, differs)
