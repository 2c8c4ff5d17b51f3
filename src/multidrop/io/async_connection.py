"""One device on one asyncio line: readings by name, confirmed writes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from functools import cached_property
from types import TracebackType
from typing import Any, Self, TypeVar

from multidrop.conversation import Conversation
from multidrop.device import Copy, Report
from multidrop.errors import Error, PortError
from multidrop.io.async_line import AsyncLine, opened
from multidrop.io.audit import AuditLog
from multidrop.io.connection import BaseConnection, Service, Target, checked, keeping
from multidrop.io.line import Timed
from multidrop.io.turns import Priority
from multidrop.naming import DeviceName
from multidrop.points import Point, Reading, Sample, Value
from multidrop.writing import Written

ResultT = TypeVar("ResultT")


class AsyncConnection(BaseConnection):
    """A device on an asyncio line. Use it in an `async with`."""

    line: AsyncLine
    on_written: Callable[[Timed[Written]], None] | None = None  # told before anything else is asked
    _acted = False  # whether what was asked last sent more than reads

    @cached_property
    def _now(self) -> Callable[[], float]:
        """The clock of the loop."""
        return asyncio.get_running_loop().time

    async def carry_out(
        self, conversation: Conversation[Any, ResultT], priority: Priority = Priority.OPERATOR
    ) -> Timed[ResultT]:
        """Any conversation with the device, in its turn."""
        self._acted = False
        line = self.line
        try:
            return await line.timed(conversation, priority, self.device.address)
        finally:
            self._acted = line.acted

    async def read(self, point: str | Point, *, priority: Priority = Priority.OPERATOR) -> Reading:
        """Read one point; raises as the blocking one does."""
        where = self.device.point(point) if isinstance(point, str) else point
        return (await self.read_group((where,), priority=priority))[0]

    async def read_group(
        self, group: Sequence[Point], *, priority: Priority = Priority.OPERATOR
    ) -> list[Reading]:
        """Read points that the device's `plan` put together; raises as `read` does."""
        conversation = self.device.read_group(group)
        return self._readings(group, await self.carry_out(conversation, priority), self._now())

    async def write(
        self,
        point: str,
        value: Value | str,
        *,
        verify: bool = True,
        force: bool = False,
        audit: AuditLog | None = None,
    ) -> Written:
        """Write one point and read it back; raises unless that is confirmed.

        `audit` is where that is recorded, if not in the log of this connection.
        """
        log = audit or self.audit
        write = self.device.prepare_write(point, value, force=force)
        log.check()
        try:
            conversation = self.device.write(write, verify=verify)
            timed = await self.carry_out(conversation, Priority.WRITE)
        except (asyncio.CancelledError, PortError) as why:
            if not self._acted:
                raise
            record = self._broken_off(write, why, log)
            if isinstance(why, asyncio.CancelledError):
                raise
            return checked(record)
        self._recorded(timed.result, log)
        if self.on_written is not None:
            self.on_written(timed)
        return checked(timed.result)

    def readings(self, points: Sequence[Point], timed: Timed[list[Sample]]) -> list[Reading]:
        """What came for these points in one conversation, each with its scale and unit."""
        return self._readings(points, timed, self._now())

    async def status(self) -> Report:
        """What the protocol offers of the device's state."""
        return (await self.carry_out(self.device.status())).result

    async def clear_faults(self) -> Report:
        """Clear the fault of a drive; one that is not in fault is left alone."""
        return await self._serve(self._clear_faults())

    async def reset_comm(self) -> Report:
        """Reset the device's serial interface, not its faults."""
        return await self._serve(self._reset_comm())

    async def raw(self, text: str) -> Report:
        """Send one command body, in hex, as is."""
        return await self._serve(self._raw(text))

    async def act(self, name: str) -> Report:
        """An action of the device by its name: homing, a reset. Sent once."""
        return await self._serve(self._act(name))

    async def copy(self, copy: Copy) -> list[Written]:
        """Carry out a copy between working and saved value, once; what is known of each point."""
        self.audit.check()
        try:
            conversation = keeping(self.device).copy(copy)
            records = (await self.carry_out(conversation, Priority.WRITE)).result
        except (Error, asyncio.CancelledError) as why:
            self._copy_failed(copy, why, self._acted)
        return self._copied(records)

    async def _serve(self, service: Service) -> Report:
        self.audit.check()
        try:
            report = (await self.carry_out(service.conversation, Priority.WRITE)).result
        except (Error, asyncio.CancelledError) as why:
            self._failed(service.what, why, self._acted)
        return self._answered(service, report, self._acted)

    async def __aenter__(self) -> Self:
        self.line = await opened(self.target.port, self.target.settings, self.target.options)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self.line.close()


def connect_async(
    device: str | DeviceName | Target, *, audit: AuditLog | None = None
) -> AsyncConnection:
    """As `connect`, for asyncio; the line is opened by `async with`."""
    target = Target.of(device)
    return AsyncConnection(target, target.device(), audit)
