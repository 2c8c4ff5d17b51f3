"""A write to every slave at once, and the proof of it: A chapter 9.

0081 to broadcast command verify means that a broadcast was received, not that
its value was taken; only the read-back of the point shows that.
"""

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
from multidrop.points import Role, Sample, Value, shown_value
from multidrop.profile import Profile
from multidrop.protocols.slink3.device import Slink3Device, dialect_of
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.messages import Command
from multidrop.protocols.slink3.points import ParameterPoint
from multidrop.protocols.slink3.values import Format
from multidrop.protocols.slink3.values import Value as RawValue
from multidrop.writing import Outcome, Written

REST = 0.1
"""s that the line rests after a broadcast, so that every slave has carried it out."""

Planned = tuple[Write, ParameterPoint, Format, RawValue, bytes]


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
    dialect = dialect_of(profile, options)
    slaves = [Slink3Device(address, profile, dialect) for address in addresses]
    speaker = Slink3Device(0, profile, dialect)
    plans = [_plan(speaker, text, value, force) for text, value in points]

    def converse() -> Conversation[Frame, list[Received]]:
        before = {}
        for slave in slaves:
            before[slave.address] = yield from _before(slave, plans, keep_going)
        for _, point, type_code, value, _ in plans:
            if point.standard:
                yield from speaker.master.broadcast_standard(
                    point.index, point.subindex or 0, type_code, value
                )
            else:
                yield from speaker.master.broadcast_typed(
                    point.index, type_code, value, point.subindex
                )
        yield Wait(REST)
        found = []
        for slave in slaves:
            found.append((yield from _after(slave, plans, before[slave.address])))
        return found

    return converse


def _plan(speaker: Slink3Device, text: str, value: str, force: bool) -> Planned:
    write = speaker.prepare_write(text, value, force=force)
    point = write.point
    assert isinstance(point, ParameterPoint)
    if point.destination:
        raise UsageError(
            f"{point} is behind destination {point.destination}, which hears no broadcast"
        )
    if point.type_code in (None, Format.VOID):
        raise UsageError(f"{point} needs a type to be broadcast, such as {point.text}:int16")
    if point.role in (Role.COMMAND, Role.COMMUNICATION) and not force:
        raise UsageError(
            f"{point} has role {point.role.value}: every slave would act on it; --force broadcasts it"
        )
    assert point.type_code is not None
    raw_value, raw = speaker.encoded(write)
    return write, point, point.type_code, raw_value, raw


class _Before:
    """What a slave said before the broadcast: its old values, and whether 0028 can prove anything."""

    def __init__(self) -> None:
        self.old: list[Sample | None] = []
        self.silent = False
        self.proves = True


def _before(
    slave: Slink3Device, plans: list[Planned], keep_going: bool
) -> Conversation[Frame, _Before]:
    found = _Before()
    try:
        for _, point, *_ in plans:
            try:
                found.old.append((yield from slave.read(point)))
            except DeviceError:
                found.old.append(None)
        if Command.BROADCAST_COMMAND_VERIFY in slave.dialect.commands:
            yield from slave.master.status_word()  # any other command clears the flag
            found.proves = not (yield from slave.master.broadcast_verify())
    except NoReply as failure:
        if not keep_going:
            raise NoReply(
                failure.attempts,
                failure.damaged,
                failure.heard,
                because=f"slave {slave.address} did not answer, so nothing was broadcast: no reply",
            ) from failure
        found.silent = True
        found.old = [None] * len(plans)
    return found


def _after(
    slave: Slink3Device, plans: list[Planned], before: _Before
) -> Conversation[Frame, Received]:
    received: bool | None = None
    note = "" if before.proves else "it already said so before: proves nothing"
    if before.silent:
        note = "it was silent before the broadcast"
    elif Command.BROADCAST_COMMAND_VERIFY in slave.dialect.commands:
        try:
            answer = yield from slave.master.broadcast_verify()
            received = answer if before.proves else None
        except (NoReply, DeviceError, ProtocolError) as failure:
            note = str(failure)
    written = []
    for plan, old in zip(plans, before.old, strict=True):
        written.append((yield from _read_back(slave, plan, old)))
    outcomes = {record.outcome for record in written}
    applied = None if Outcome.UNKNOWN in outcomes else outcomes <= {Outcome.CONFIRMED}
    return Received(slave.address, received, applied, note, tuple(written))


def _read_back(
    slave: Slink3Device, plan: Planned, old: Sample | None
) -> Conversation[Frame, Written]:
    write, point, _, _, raw = plan
    asked: Value = slave.asked(write)
    try:
        found = yield from slave.read(point)
    except (NoReply, DeviceError, ProtocolError) as failure:
        unknown = OutcomeUnknown(f"slave {slave.address}, {point}: {failure}", step="the read-back")
        return Written(point, asked, Outcome.UNKNOWN, old, None, unknown)
    if found.raw == raw:
        return Written(point, asked, Outcome.CONFIRMED, old, found)
    differs = NotApplied(
        f"slave {slave.address}, {point}: {shown_value(asked)} was broadcast, {shown_value(found.value)} is read back",
        found=found.value,
    )
    return Written(point, asked, Outcome.DIFFERS, old, found, differs)
