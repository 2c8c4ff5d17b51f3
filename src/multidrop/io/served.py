"""A device of a line service: what is asked of it is counted, and tells whether it is there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from multidrop.conversation import Conversation, once
from multidrop.errors import DeviceError, NoReply, ProtocolError
from multidrop.io.async_connection import AsyncConnection
from multidrop.io.async_line import AsyncLine
from multidrop.io.audit import AuditLog
from multidrop.io.connection import Target
from multidrop.io.health import DeviceCounters, Health, Load
from multidrop.io.kept_port import KeptPort
from multidrop.io.line import Timed
from multidrop.io.turns import Priority
from multidrop.points import Point, Reading
from multidrop.writing import Written

ResultT = TypeVar("ResultT")

WEIGHT = 1 / 8
"""Of the newest answer delay in the one that is reckoned with."""


class ServedDevice(AsyncConnection):
    """A device on a line that comes and goes: `PortError` at once while it is away."""

    def __init__(
        self,
        name: str,
        target: Target,
        audit: AuditLog | None,
        port: KeptPort,
        health: Health,
        load: Load,
        on_silent: Callable[[], None],
    ) -> None:
        super().__init__(target, target.device(), audit)
        self.short_name = name
        self.counters = DeviceCounters()
        self.polled = 0  # how many pollings ask it
        self.last_error: NoReply | None = None
        self._port = port
        self._health = health
        self._load = load
        self._on_silent = on_silent

    @property
    def line(self) -> AsyncLine:  # type: ignore[override]
        return self._port.line

    async def carry_out(
        self, conversation: Conversation[Any, ResultT], priority: Priority = Priority.OPERATOR
    ) -> Timed[ResultT]:
        """Any conversation with the device, in its turn; what came of it is counted."""
        self._acted = False
        line = self.line
        try:
            timed = await line.timed(
                self._watched(conversation, line), priority, self.device.address
            )
        except NoReply as silence:
            self.last_error = silence
            if self.polled and self._health.not_heard(self.short_name, self._now()):
                self._on_silent()
            raise
        except (DeviceError, ProtocolError) as answer:
            self.counters.refusals += isinstance(answer, DeviceError)
            self._health.heard(self.short_name)
            raise
        finally:
            self._acted = line.acted
        self._health.heard(self.short_name)
        return timed

    async def poll_group(self, group: Sequence[Point], priority: Priority) -> list[Reading]:
        """Read a group as a poll does: silence costs one time-out, damage is asked again."""
        attempts = self.target.settings.attempts
        conversation = _patient(lambda: self.device.read_group(group), attempts)
        return self._readings(group, await self.carry_out(conversation, priority), self._now())

    def notice_delay(self, seconds: float) -> None:
        """It answered so long after the end of the question."""
        known, found = self.counters.delay, max(0.0, seconds)
        self.counters.delay = found if known is None else known + (found - known) * WEIGHT

    def _watched(
        self, conversation: Conversation[Any, ResultT], line: AsyncLine
    ) -> Conversation[Any, ResultT]:
        """The same conversation; what happens on the line from its first to its last step is this device's."""
        counted, start = line.counters, self._now()
        before = counted.copy()
        try:
            result = yield from conversation
            if isinstance(result, Written) and isinstance(result.error, DeviceError):
                self.counters.refusals += 1
            return result
        finally:
            end = self._now()
            self.counters.busy += end - start
            self._load.add(start, end)
            self.counters.count_since(before, counted)


def _patient(
    converse: Callable[[], Conversation[Any, ResultT]], attempts: int
) -> Conversation[Any, ResultT]:
    """Each question once; all over again, up to `attempts` times, where damaged bytes came instead."""
    while True:
        try:
            return (yield from once(converse()))
        except NoReply as failure:
            attempts -= 1
            if not failure.damaged or not attempts:
                raise
