"""A write to every slave at once, and what can be proved of it: by the slaves named, one by one.

Nobody answers a broadcast. So the old values are read first, then it goes out once, and after
a rest each slave named is asked what it can tell and the points are read back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from multidrop.conversation import Conversation, Wait
from multidrop.device import Received
from multidrop.errors import (
    DeviceError,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    ProtocolError,
    UsageError,
)
from multidrop.points import Point, Role, Sample, Value, shown_value
from multidrop.writing import Outcome, Written

REST = 0.1
"""s that the line rests after a broadcast, so that every slave has carried it out."""


@dataclass(frozen=True, slots=True)
class Spoken:
    """One point of a broadcast. `wanted` gives the bytes that its read-back must show.

    A point that cannot be read, because it is an action, has none.
    """

    point: Point
    asked: Value
    send: Callable[[], Conversation[Any, None]]
    wanted: Callable[[Sample], bytes] | None


class Hearer(Protocol):
    """A slave that is asked before and after a broadcast."""

    called: str  # what the protocol's documents call it
    address: int

    def prepare(self) -> Conversation[Any, bool]:
        """Right before the broadcast; whether `received` will prove anything."""
        ...

    def received(self) -> Conversation[Any, bool | None]:
        """Whether it says that it received the broadcast; None where it cannot say."""
        ...

    def read(self, point: Point) -> Conversation[Any, Sample]: ...


@dataclass(frozen=True, slots=True)
class _Before:
    """What a slave said before: its old values, None where it does not give one."""

    old: Sequence[Sample | None]
    proves: bool = True
    silent: bool = False


def check_role(point: Point, called: str, *, force: bool) -> None:
    """What makes every slave act, or all of them deaf, is only broadcast by force. Raises `UsageError`."""
    if point.role in (Role.COMMAND, Role.COMMUNICATION) and not force:
        raise UsageError(
            f"{point} has role {point.role.value}: every {called} would act on it; --force broadcasts it"
        )


def broadcast(
    spoken: Sequence[Spoken], hearers: Sequence[Hearer], *, keep_going: bool
) -> Conversation[Any, list[Received]]:
    """Carry it out. Raises `NoReply` before anything went out, unless `keep_going`."""
    before = {}
    for hearer in hearers:
        before[hearer.address] = yield from _before(hearer, spoken, keep_going)
    for one in spoken:
        yield from one.send()
    yield Wait(REST)
    found = []
    for hearer in hearers:
        found.append((yield from _after(hearer, spoken, before[hearer.address])))
    return found


def _before(
    hearer: Hearer, spoken: Sequence[Spoken], keep_going: bool
) -> Conversation[Any, _Before]:
    old = []
    try:
        for one in spoken:
            old.append((yield from _old(hearer, one)))
        proves = yield from hearer.prepare()
    except NoReply as failure:
        if keep_going:
            return _Before([None] * len(spoken), silent=True)
        raise NoReply(
            failure.attempts,
            failure.damaged,
            failure.heard,
            because=f"{hearer.called} {hearer.address} did not answer, so nothing was broadcast: no reply",
        ) from failure
    return _Before(old, proves)


def _old(hearer: Hearer, one: Spoken) -> Conversation[Any, Sample | None]:
    if one.wanted is None:
        return None
    try:
        return (yield from hearer.read(one.point))
    except (DeviceError, ProtocolError):
        return None


def _after(
    hearer: Hearer, spoken: Sequence[Spoken], before: _Before
) -> Conversation[Any, Received]:
    received: bool | None = None
    note = "" if before.proves else "it already said so before: proves nothing"
    if before.silent:
        note = "it was silent before the broadcast"
    else:
        try:
            answer = yield from hearer.received()
            received = answer if before.proves else None
        except (NoReply, DeviceError, ProtocolError) as failure:
            note = str(failure)
    written = []
    for one, old in zip(spoken, before.old, strict=True):
        written.append((yield from _read_back(hearer, one, old)))
    outcomes = {record.outcome for record in written}
    known = outcomes <= {Outcome.CONFIRMED, Outcome.DIFFERS}
    applied = outcomes <= {Outcome.CONFIRMED} if known else None
    return Received(hearer.address, received, applied, note, tuple(written))


def _read_back(hearer: Hearer, one: Spoken, old: Sample | None) -> Conversation[Any, Written]:
    point, who = one.point, f"{hearer.called} {hearer.address}"
    if one.wanted is None:
        return Written(point, one.asked, Outcome.UNVERIFIED)
    try:
        found = yield from hearer.read(point)
    except (NoReply, DeviceError, ProtocolError) as failure:
        unknown = OutcomeUnknown(f"{who}, {point}: {failure}", step="the read-back")
        return Written(point, one.asked, Outcome.UNKNOWN, old, None, unknown)
    if found.raw == one.wanted(found):
        return Written(point, one.asked, Outcome.CONFIRMED, old, found)
    value = point.physical(found.value)
    differs = NotApplied(
        f"{who}, {point}: {shown_value(one.asked)} was broadcast, {shown_value(value)} is read back",
        found=value,
    )
    return Written(point, one.asked, Outcome.DIFFERS, old, found, differs)
