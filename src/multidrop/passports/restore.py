"""Restore: a passport's values onto a device, as a plan that can be read before and proved after.

Nothing is written that the plan did not show. Every write goes through the rule
"sent once" and is read back; the end is a verdict for each point.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from multidrop.device import KeepsMemory, Write
from multidrop.errors import DeviceError, Error, NoReply, PortError, UsageError
from multidrop.io.connection import Connection, keeping
from multidrop.io.readings import in_order
from multidrop.passports.backup import Backup, entry, passport
from multidrop.passports.difference import same
from multidrop.passports.passport import Entry, Passport
from multidrop.points import Role, Value
from multidrop.writing import Outcome, Written

ON_REQUEST = (Role.SETPOINT, Role.COMMUNICATION, Role.IDENTITY, Role.UNKNOWN)
"""Roles that are restored where they are named."""

_ORDER = {
    Role.SETTING: 0,
    Role.UNKNOWN: 1,
    Role.IDENTITY: 2,
    Role.SETPOINT: 3,
    Role.COMMUNICATION: 4,
}
"""Settings first; what may cut the line last."""


class Action(StrEnum):
    """What the plan does with a point."""

    WRITE = "write"
    SAME = "same"  # the device holds the value already
    SKIP = "skip"  # by rule


class Verdict(StrEnum):
    """What is known of a point at the end."""

    RESTORED = "restored"
    SAME = "same"
    SKIPPED = "skipped"
    REFUSED = "refused"
    DIFFERS = "differs"
    UNKNOWN = "unknown"
    NOT_WRITTEN = "not-written"
    NOT_SAVED = "not-saved"  # restored, and lost when the power is


@dataclass(frozen=True, slots=True)
class Step:
    """One point of a plan. `now` is what the device holds, None where that is not read."""

    wanted: Entry
    action: Action
    reason: str = ""
    now: Entry | None = None
    write: Write | None = None

    @property
    def point(self) -> str:
        """Where it is written: the passport's point, or its non-volatile value."""
        return self.wanted.point if self.write is None else self.write.point.text


@dataclass(frozen=True, slots=True)
class Plan:
    """What a restore would do, in the order it would do it, and what the device was doing."""

    steps: Sequence[Step]
    running: str | None

    @property
    def writes(self) -> list[Step]:
        return [step for step in self.steps if step.action is Action.WRITE]


@dataclass(frozen=True, slots=True)
class Restored:
    """The verdict on one step; `record` is that of its write."""

    step: Step
    verdict: Verdict
    record: Written | None = None
    error: Error | None = None


def plan(
    connection: Connection,
    wanted: Passport,
    include: Collection[Role] = (),
    *,
    force: bool = False,
    past_limits: bool = False,
) -> Plan:
    """Work out what has to be written, by reading what the device holds now.

    `force` takes a passport of a device that says it is of another model or
    firmware, `past_limits` values that the profile's limits do not allow.

    Raises `UsageError` where the passport does not belong to such a device, or
    holds a value that the profile does not allow: then nothing may be written.
    """
    _check_model(connection, wanted)
    steps = [
        _by_rule(connection, item, include, past_limits=past_limits)
        for item in wanted.points.values()
    ]
    _check_fits(steps)
    if not force:
        _check_identity(connection, wanted)
    steps = sorted(_compared(connection, steps), key=lambda step: _ORDER.get(step.wanted.role, 9))
    _check_fits(steps)
    return Plan(steps, connection.line.run(connection.device.running()))


def undo(connection: Connection, planned: Plan) -> Passport:
    """What the device holds now of everything that will be written: restored, it undoes the restore."""
    before = {step.now.point: step.now for step in planned.writes if step.now is not None}
    return passport(connection.target, before)


def carry_out(
    connection: Connection, planned: Plan, *, stop: bool = False, keep: bool = False
) -> Iterator[Restored]:
    """Write the plan, each point with its verdict as soon as that is known.

    With `keep` each restored value is copied into the device's non-volatile
    memory, where it has such a copy.

    A refusal does not stop the rest unless `stop`; what was refused is tried
    once more at the end, since limits may depend on one another. A device or a
    port that is gone ends it: what is left is not written.
    """
    again: list[Step] = []
    ended: Error | None = None
    for step in planned.steps:
        if step.action is not Action.WRITE:
            kept = Verdict.SAME if step.action is Action.SAME else Verdict.SKIPPED
            yield Restored(step, kept)
            continue
        done = _write(connection, step, keep=keep) if ended is None else _left(step, ended)
        if done.verdict is Verdict.REFUSED and not stop:
            again.append(step)
            continue
        if _is_over(done) or (stop and done.verdict is not Verdict.RESTORED):
            ended = ended or done.error
        yield done
    for step in again:
        done = _write(connection, step, keep=keep) if ended is None else _left(step, ended)
        ended = ended or (done.error if _is_over(done) else None)
        yield done


# -- planning ---------------------------------------------------------------------------------


def _check_model(connection: Connection, wanted: Passport) -> None:
    profile = connection.target.profile
    if wanted.profile != profile.name:
        raise UsageError(
            f"the passport is of profile {wanted.profile}, the device of {profile.name};"
            " nothing was written"
        )
    if wanted.profile_version != profile.version:
        raise UsageError(
            f"the passport was made with version {wanted.profile_version!r} of profile {profile.name},"
            f" this is version {profile.version!r}; nothing was written"
        )


def _check_identity(connection: Connection, wanted: Passport) -> None:
    """What a device says of itself and nobody can write must be the same: model, firmware."""
    fixed = [
        item
        for item in wanted.points.values()
        if item.role is Role.IDENTITY and not _writable(connection, item)
    ]
    points = [connection.device.point(item.point) for item in fixed]
    for item, (point, found) in zip(fixed, in_order(connection, points), strict=True):
        if isinstance(found, Error):
            raise found
        if not same(item, entry(point, found)):
            raise UsageError(
                f"{point}: the passport says {item.value!r}, the device {found.value!r}: it is another"
                " model or firmware; nothing was written (--force restores all the same)"
            )


def _writable(connection: Connection, item: Entry) -> bool:
    try:
        description = connection.device.point(item.point).description
    except UsageError:
        return True  # not in the profile: skipped by rule elsewhere
    return description is None or "w" in description.access


def _check_fits(steps: Sequence[Step]) -> None:
    refused = [step.reason for step in steps if step.reason and step.action is Action.WRITE]
    if refused:
        more = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
        raise UsageError(f"the passport does not fit: {refused[0]}{more}; nothing was written")


def _by_rule(
    connection: Connection, item: Entry, include: Collection[Role], *, past_limits: bool
) -> Step:
    """What can be said of a point before anything is sent. A `WRITE` with a reason cannot be done."""
    if item.role in (Role.MEASURED, Role.COMMAND):
        return Step(item, Action.SKIP, f"{item.role} points are never restored")
    if item.role in ON_REQUEST and item.role not in include:
        return Step(item, Action.SKIP, f"role {item.role} (--include {item.role} restores it)")
    try:
        point = connection.device.point(item.point)
    except UsageError as error:
        return Step(item, Action.SKIP, f"not in the profile: {error}")
    if point.description is None:
        return Step(item, Action.SKIP, "not in the profile")
    if point.text != item.point:  # it may stand there twice, with two values
        return Step(item, Action.SKIP, f"a passport names this point {point.text}")
    if point.role is not item.role:
        return Step(item, Action.SKIP, f"its role is {point.role} in the profile")
    if "w" not in point.description.access:
        return Step(item, Action.SKIP, "read-only")
    try:
        write = _prepared(connection, item, past_limits=past_limits)
    except UsageError as error:
        return Step(item, Action.WRITE, f"{item.point}: {error}")
    return Step(item, Action.WRITE, write=write)


def _prepared(connection: Connection, item: Entry, *, past_limits: bool) -> Write:
    """The write of a point; the non-volatile one of a point that takes no other. Raises `UsageError`."""
    try:
        return connection.prepare(item.point, item.value)
    except UsageError as refused:
        if isinstance(connection.device, KeepsMemory):
            with contextlib.suppress(UsageError):
                return connection.prepare(f"{item.point}@nv", item.value)
        if not past_limits:
            raise refused from None
    return connection.prepare(item.point, item.value, force=True)


def _compared(connection: Connection, steps: Sequence[Step]) -> Iterator[Step]:
    """The steps with what the device holds; those that it holds already fall out of the plan."""
    points = [step.write.point for step in steps if step.write is not None]
    held = Backup(connection, points)
    for _ in held.run():
        pass
    for step in steps:
        yield step if step.write is None else _with_present(step, step.write.point.text, held)


def _with_present(step: Step, point: str, held: Backup) -> Step:
    failed = held.failed.get(point)
    if isinstance(failed, DeviceError):
        return replace(step, action=Action.SKIP, reason=f"the device does not show it: {failed}")
    if failed is not None:
        raise failed
    now = held.found[point]
    if _kind(step.wanted.value) is not _kind(now.value):
        reason = f"{step.wanted.point}: {step.wanted.value!r}, and the device has {now.value!r}"
        return replace(step, now=now, reason=reason)
    return replace(step, now=now, action=Action.SAME if same(step.wanted, now) else Action.WRITE)


def _kind(value: Value) -> type:
    return float if type(value) is int else type(value)


# -- writing ----------------------------------------------------------------------------------


def _write(connection: Connection, step: Step, *, keep: bool) -> Restored:
    assert step.write is not None
    try:
        record = connection.carry_out(step.write)
        done = Restored(step, _verdict(record), record, record.error)
        return _kept(connection, done) if keep and done.verdict is Verdict.RESTORED else done
    except Error as error:  # nothing was sent
        return Restored(step, Verdict.NOT_WRITTEN, error=error)


def _kept(connection: Connection, done: Restored) -> Restored:
    """Saved as well; a point that cannot be saved keeps itself."""
    assert done.step.write is not None
    try:
        copy = keeping(connection.device).prepare_copy(done.step.write.point.text, save=True)
    except UsageError:
        return done
    for record in connection.copy(copy):
        if record.error is not None:
            return replace(done, verdict=Verdict.NOT_SAVED, record=record, error=record.error)
    return done


def _verdict(record: Written) -> Verdict:
    if record.outcome is Outcome.CONFIRMED:
        return Verdict.RESTORED
    if record.outcome is Outcome.NOT_APPLIED:
        return Verdict.REFUSED if isinstance(record.error, DeviceError) else Verdict.DIFFERS
    return Verdict.DIFFERS if record.outcome is Outcome.DIFFERS else Verdict.UNKNOWN


def _left(step: Step, why: Error) -> Restored:
    return Restored(step, Verdict.NOT_WRITTEN, error=why)


def _is_over(done: Restored) -> bool:
    """Whether nobody is there any more to write to."""
    reasons = (done.error, done.error.__cause__ if done.error is not None else None)
    return any(isinstance(why, PortError | NoReply | KeyboardInterrupt) for why in reasons)
