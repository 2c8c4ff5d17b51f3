"""One device on one line: readings by name, confirmed writes.

Blocking; `async_connection.py` has the same for asyncio.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from types import TracebackType
from typing import Any, NoReturn, Self

from multidrop.catalog import load_profile
from multidrop.conversation import Conversation
from multidrop.device import Acts, Copy, Device, KeepsMemory, ProtocolModule, Report, Write
from multidrop.errors import DeviceError, Error, NotApplied, OutcomeUnknown, PortError, UsageError
from multidrop.io.audit import AuditLog
from multidrop.io.line import Line, Timed
from multidrop.io.ports import PortSetup, open_port
from multidrop.naming import DeviceName, LineOptions, parse_device
from multidrop.points import Point, Reading, Sample, Value
from multidrop.profile import Profile
from multidrop.protocols import PROTOCOLS
from multidrop.timing import Format, LineSettings
from multidrop.writing import Outcome, Written


class Target:
    """A device's name worked out: protocol, profile, line settings, options. Nothing is open yet."""

    def __init__(self, name: DeviceName, profile: Profile | None = None) -> None:
        self.name = name
        self.profile = profile or load_profile(name.profile)
        self.protocol: ProtocolModule = PROTOCOLS[self.profile.protocol]
        self.options = LineOptions.parse(name.options, self.protocol.options)
        self.settings = line_settings(self.protocol, self.profile, self.options)

    @classmethod
    def of(cls, device: str | DeviceName | Target) -> Target:
        """Raises `UsageError` where the name cannot be understood."""
        if isinstance(device, Target):
            return device
        return cls(parse_device(device) if isinstance(device, str) else device)

    def device(self) -> Device:
        assert self.name.address is not None
        return self.protocol.device(self.name.address, self.profile, self.options.own)

    def same(self, other: Target) -> bool:
        """Whether both are one device, known alike."""
        return (self.name, self.profile) == (other.name, other.profile)

    @property
    def port(self) -> str:
        return self.name.port

    def setup(self) -> PortSetup:
        return PortSetup(self.settings, self.options)


def line_settings(protocol: ProtocolModule, profile: Profile, options: LineOptions) -> LineSettings:
    """The protocol's settings, the profile's over them, and what the user set over both."""
    character = Format.parse(profile.format) if profile.format else None
    settings = protocol.line_for(options.own).with_options(baud=profile.baud, format=character)
    return settings.with_options(**options.line_settings())


@dataclass(frozen=True, slots=True)
class Service:
    """A command that may act, and what is known of it once it was answered."""

    what: str
    conversation: Conversation[Any, Report]
    outcome: Outcome


def acting(device: Device) -> Acts:
    """The device as one that has actions. Raises `UsageError`."""
    if not isinstance(device, Acts):
        raise UsageError(f"{device.profile.name} has no actions")
    return device


def keeping(device: Device) -> KeepsMemory:
    """The device as one that keeps saved values. Raises `UsageError`."""
    if not isinstance(device, KeepsMemory):
        raise UsageError(f"{device.profile.name} keeps no saved values beside the working ones")
    return device


class BaseConnection:
    """What blocking and asyncio connections share: everything that does not touch the line."""

    def __init__(self, target: Target, device: Device, audit: AuditLog | None) -> None:
        self.target = target
        self.device = device
        self.audit = audit or AuditLog(origin="python")
        self.name = str(target.name)

    def _readings(
        self, group: Sequence[Point], timed: Timed[list[Sample]], now: float
    ) -> list[Reading]:
        """Samples with their scale, unit and time."""
        received = datetime.fromtimestamp(time.time() - (now - timed.received_at), UTC)
        ms = round(timed.seconds * 1000, 3)
        return [
            point.reading(sample, received, ms)
            for point, sample in zip(group, timed.result, strict=True)
        ]

    def prepare_copy(self, point: str, *, save: bool, force: bool = False) -> Copy:
        """Check a copy to (`save`) or from the saved value of a point; nothing is sent."""
        return keeping(self.device).prepare_copy(point, save=save, force=force)

    def prepare(self, point: str, value: Value | str, *, force: bool = False) -> Write:
        """Parse, resolve and range-check a write, and the audit log; nothing is sent."""
        write = self.device.prepare_write(point, value, force=force)
        self.audit.check()
        return write

    def _broken_off(
        self, write: Write, why: BaseException, audit: AuditLog | None = None
    ) -> Written:
        """The record of a write that went out before its line or its caller was lost."""
        reason = str(why) or "interrupted"
        lost = OutcomeUnknown(
            f"{write.point}: the write of {write.value!r} went out, then: {reason}", step=reason
        )
        lost.__cause__ = why
        record = Written(write.point, write.value, Outcome.UNKNOWN, error=lost)
        return self._recorded(record, audit or self.audit)

    def _recorded(self, record: Written, audit: AuditLog) -> Written:
        with recording(f"{record.point}: the write ({record.outcome.value})"):
            audit.written(self.name, record)
        return record

    def _clear_faults(self) -> Service:
        return Service("clear-faults", self.device.clear_faults(), Outcome.CONFIRMED)

    def _reset_comm(self) -> Service:
        return Service("reset-comm", self.device.reset_comm(), Outcome.UNVERIFIED)

    def _raw(self, text: str) -> Service:
        return Service(f"raw {text}", self.device.prepare_raw(text)(), Outcome.UNVERIFIED)

    def _act(self, name: str) -> Service:
        return Service(name, acting(self.device).prepare_action(name)(), Outcome.CONFIRMED)

    def _copied(self, records: list[Written]) -> list[Written]:
        return [self._recorded(record, self.audit) for record in records]

    def _copy_failed(self, copy: Copy, why: BaseException, acted: bool) -> NoReturn:
        self._failed(f"{'save' if copy.save else 'load'} {copy.point}", why, acted)

    def _answered(self, service: Service, report: Report, acted: bool) -> Report:
        if acted:
            outcome = service.outcome.value
            with recording(service.what):
                self.audit.append(self.name, service.what, outcome=outcome, answer=report.fields)
        return report

    def _failed(self, what: str, why: BaseException, acted: bool) -> NoReturn:
        """Log what was sent, and raise: a line or a caller that was lost leaves the outcome open."""
        if acted:
            reason = str(why) or "interrupted"
            refused = isinstance(why, DeviceError | NotApplied)
            outcome = Outcome.NOT_APPLIED if refused else Outcome.UNKNOWN
            with recording(what):
                self.audit.append(self.name, what, outcome=outcome.value, error=reason)
            if isinstance(why, KeyboardInterrupt | PortError):
                raise OutcomeUnknown(f"{what} went out, then: {reason}", step=reason) from why
        raise why


@contextmanager
def recording(what: str) -> Iterator[None]:
    """Something went out and is written into the log. Raises `OutcomeUnknown` where that takes nothing."""
    try:
        yield
    except OSError as error:  # it had room before
        raise OutcomeUnknown(
            f"{what} went out and could not be recorded: {error}", step="the audit log"
        ) from error


def checked(record: Written) -> Written:
    if record.error is not None:
        raise record.error
    return record


class Connection(BaseConnection):
    """A device on a blocking line. Use it in a `with`."""

    def __init__(
        self, target: Target, device: Device, line: Line, audit: AuditLog | None = None
    ) -> None:
        super().__init__(target, device, audit)
        self.line = line

    def read(self, point: str | Point) -> Reading:
        """Read one point. Raises `UsageError`, `DeviceError`, `NoReply`, `ProtocolError`, `PortError`."""
        where = self.device.point(point) if isinstance(point, str) else point
        return self.read_group((where,))[0]

    def read_group(self, group: Sequence[Point]) -> list[Reading]:
        """Read points that the device's `plan` put together; raises as `read` does."""
        timed = self.line.timed(self.device.read_group(group))
        now = self.line.port.now()
        return self._readings(group, timed, now)

    def read_groups(self, groups: Sequence[Sequence[Point]]) -> Iterator[list[Reading] | Error]:
        """Read groups of points one behind the other; what went wrong with one is given as its error.

        The next one is on the wire before a group's readings are given, so whoever
        takes them late has later ones with a time that is late.
        """
        asked = map(self.device.read_group, groups)
        for group, found in zip(groups, self.line.each(asked), strict=True):
            if isinstance(found, Error):
                yield found
            else:
                yield self._readings(group, found, self.line.port.now())

    def write(
        self, point: str, value: Value | str, *, verify: bool = True, force: bool = False
    ) -> Written:
        """Write one point and read it back; raises unless that is confirmed."""
        return checked(self.carry_out(self.prepare(point, value, force=force), verify=verify))

    def carry_out(self, write: Write, *, verify: bool = True) -> Written:
        """Carry out a prepared write; what is known of it is in the record. Raises where nothing was sent."""
        self.line.acted = False
        try:
            record = self.line.run(self.device.write(write, verify=verify))
        except (KeyboardInterrupt, PortError) as why:
            if self.line.acted:
                return self._broken_off(write, why)
            raise
        return self._recorded(record, self.audit)

    def status(self) -> Report:
        """What the protocol offers of the device's state."""
        return self.line.run(self.device.status())

    def clear_faults(self) -> Report:
        """Clear the fault of a drive; one that is not in fault is left alone."""
        return self._serve(self._clear_faults())

    def reset_comm(self) -> Report:
        """Reset the device's serial interface, not its faults."""
        return self._serve(self._reset_comm())

    def raw(self, text: str) -> Report:
        """Send one command body, in hex, as is."""
        return self._serve(self._raw(text))

    def act(self, name: str) -> Report:
        """An action of the device by its name: homing, a reset. Sent once."""
        return self._serve(self._act(name))

    def copy(self, copy: Copy) -> list[Written]:
        """Carry out a copy between working and saved value, once; what is known of each point."""
        self.audit.check()
        self.line.acted = False
        try:
            records = self.line.run(keeping(self.device).copy(copy))
        except (Error, KeyboardInterrupt) as why:
            self._copy_failed(copy, why, self.line.acted)
        return self._copied(records)

    def _serve(self, service: Service) -> Report:
        self.audit.check()
        self.line.acted = False
        try:
            report = self.line.run(service.conversation)
        except (Error, KeyboardInterrupt) as why:
            self._failed(service.what, why, self.line.acted)
        return self._answered(service, report, self.line.acted)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.line.close()


def connect(device: str | DeviceName | Target, *, audit: AuditLog | None = None) -> Connection:
    """Open the line of a device, `PROFILE:ADDRESS@PORT[,key=value]...`, for blocking use.

    Raises `UsageError` before anything is opened, `PortError` where the port
    cannot be.
    """
    target = Target.of(device)
    worked_out = target.device()
    line = Line(open_port(target.port, target.setup()), target.settings, target.options)
    return Connection(target, worked_out, line, audit)
