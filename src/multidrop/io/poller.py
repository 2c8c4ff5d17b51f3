"""Carries out a poll plan on a line, and says of every point what came and how good it is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum

from multidrop.errors import Error, NoReply, PortError, ProtocolError
from multidrop.io.health import Health
from multidrop.io.kept_port import KeptPort
from multidrop.io.polling import Plan, Poll, Schedule, wire_time
from multidrop.io.served import ServedDevice
from multidrop.io.turns import Priority
from multidrop.points import Point, Reading, Value

WORKERS = 2
"""Polls that are on their way: one has the line, the next already waits for its turn."""

STALE_AFTER = 3
"""Periods, and one second, after which a point that nothing was heard of is said to be stale."""

CHECK_AGE = 0.5
"""s between two looks at the points' ages."""


class Quality(StrEnum):
    """How far a polled value can be trusted."""

    GOOD = "good"  # it was just read
    STALE = "stale"  # the line was too busy to read it for three periods
    REFUSED = "refused"  # the device answered that it does not give it
    WRONG = "wrong answer"  # the answer breaks the rules of the protocol
    NO_REPLY = "no reply"
    PORT_LOST = "port lost"


@dataclass(frozen=True, slots=True)
class Polled:
    """What is known of a point now, at `time` (UTC).

    `reading` is the newest good one, with its own time; None before the first.
    `error` says why there is no newer one; None where the quality is good or stale.
    """

    device: str
    point: Point
    quality: Quality
    time: datetime
    reading: Reading | None = None
    error: Error | None = None

    @property
    def good(self) -> bool:
        return self.quality is Quality.GOOD

    @property
    def value(self) -> Value | None:
        """The newest good value, physical."""
        return self.reading.value if self.reading is not None else None


OnReading = Callable[[Polled], None]


@dataclass(slots=True)
class _Known:
    """The newest of a point: its last good reading, and when anything was last said of it."""

    every: float
    said: float
    reading: Reading | None = None
    stale: bool = False


class Polling:
    """One plan that is being polled. `missed` counts the periods that went by unread."""

    def __init__(
        self,
        plan: Plan,
        devices: Mapping[str, ServedDevice],
        port: KeptPort,
        health: Health,
        on_reading: OnReading,
    ) -> None:
        self.plan = plan
        self.missed = 0
        self._devices = devices
        self._port = port
        self._health = health
        self._on_reading = on_reading
        self._loop = asyncio.get_running_loop()
        self._now = self._loop.time
        self._ended: asyncio.Future[None] = self._loop.create_future()
        self._schedule = Schedule(plan, self._now())
        self._known = {
            (poll.name, point): _Known(poll.every, self._now() + poll.phase)
            for poll in plan.polls
            for point in poll.group
        }
        self.names = {poll.name for poll in plan.polls}

    async def run(self) -> None:
        """Until it is cancelled or ended; raises what `on_reading` raises."""
        tasks = [asyncio.create_task(self._work()) for _ in range(WORKERS)]
        tasks.append(asyncio.create_task(self._watch_ages()))
        try:
            ended = [*tasks, self._ended]
            done, _ = await asyncio.wait(ended, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in (*tasks, self._ended):
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def end(self, error: BaseException | None = None) -> None:
        """Let `run` return, or raise."""
        if self._ended.done():
            return
        if error is None:
            self._ended.set_result(None)
        else:
            self._ended.set_exception(error)

    def cheapest(self, name: str) -> Poll | None:
        """The poll of a device that takes the line for the shortest time."""
        polls = [poll for poll in self.plan.polls if poll.name == name]
        return min(polls, key=lambda poll: poll.seconds, default=None)

    async def ask(self, poll: Poll, priority: Priority) -> Error | None:
        """Read one poll's points, and say what came. Returns why none did."""
        device = self._devices[poll.name]
        try:
            readings = await device.poll_group(poll.group, priority)
        except Error as error:
            self._say_all(poll, quality_of(error), error)
            return error
        if len(poll.sizes) == 1:
            on_the_wire = wire_time(self.plan.settings, poll.sizes)
            device.notice_delay(readings[0].ms / 1000 - on_the_wire)
        for point, reading in zip(poll.group, readings, strict=True):
            self._say(poll.name, point, Quality.GOOD, reading=reading)
        return None

    async def _work(self) -> None:
        schedule = self._schedule
        while True:
            now = self._now()
            due = schedule.take(now)
            if due is None:
                await asyncio.sleep(schedule.deadline - now)
                continue
            await self._poll(due.poll)
            self.missed += schedule.finish(due, self._now())

    async def _poll(self, poll: Poll) -> None:
        """Ask, unless it is known that no answer can come."""
        if self._port.lost is not None:
            self._say_all(poll, Quality.PORT_LOST, self._port.lost)
            await asyncio.sleep(poll.seconds)
        elif self._health.silent_since(poll.name) is not None:
            self._say_all(poll, Quality.NO_REPLY, self._devices[poll.name].last_error)
            nobody = self.names <= set(self._health.silent)
            await asyncio.sleep(poll.seconds if nobody else 0.0)
        else:
            await self.ask(poll, Priority.POLL)

    async def _until_the_next_check(self) -> None:
        """`CHECK_AGE`, and once more where this program stood still: it could not even ask meanwhile."""
        began = self._now()
        await asyncio.sleep(CHECK_AGE)
        if self._now() - began > 2 * CHECK_AGE:
            await asyncio.sleep(CHECK_AGE)

    async def _watch_ages(self) -> None:
        while True:
            await self._until_the_next_check()
            now = self._now()
            for (name, point), known in self._known.items():
                late = now - known.said > STALE_AFTER * known.every + 1.0
                if late and not known.stale:
                    self._say(name, point, Quality.STALE)
                    known.stale = True

    def _say_all(self, poll: Poll, quality: Quality, error: Error | None) -> None:
        for point in poll.group:
            self._say(poll.name, point, quality, error=error)

    def _say(
        self,
        name: str,
        point: Point,
        quality: Quality,
        *,
        reading: Reading | None = None,
        error: Error | None = None,
    ) -> None:
        known = self._known[name, point]
        known.said, known.stale = self._now(), False
        if reading is not None:
            known.reading = reading
        if self._ended.done():
            return  # nobody listens any more
        try:
            self._on_reading(Polled(name, point, quality, datetime.now(UTC), known.reading, error))
        except Exception as raised:
            self.end(raised)


def quality_of(error: Error) -> Quality:
    """What a failed read says of the value."""
    if isinstance(error, NoReply):
        return Quality.NO_REPLY
    if isinstance(error, PortError):
        return Quality.PORT_LOST
    return Quality.WRONG if isinstance(error, ProtocolError) else Quality.REFUSED


def points_of(device: ServedDevice, texts: str | Sequence[str | Point]) -> tuple[Point, ...]:
    """Points by text, ranges and arrays included. Raises `UsageError`."""
    found: list[Point] = []
    for text in [texts] if isinstance(texts, str) else texts:
        found += device.device.points(text) if isinstance(text, str) else [text]
    return tuple(found)
