"""Carries out a poll plan on a line, and says of every point what came and how good it is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import NamedTuple

from multidrop.errors import Error, NoReply, PortError, ProtocolError
from multidrop.io.health import Health
from multidrop.io.kept_port import KeptPort
from multidrop.io.polling import Plan, Poll, Schedule, wire_time
from multidrop.io.served import ServedDevice
from multidrop.io.turns import Priority
from multidrop.points import Point, Reading, Value

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


class Polled(NamedTuple):
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

    device: str
    point: Point
    every: float
    said: float
    reading: Reading | None = None
    stale: bool = False


@dataclass(frozen=True, slots=True)
class Standing:
    """A poll of the plan with what it needs each time.

    `on_the_wire` is how long its characters take, s; None where it is several messages.
    """

    poll: Poll
    device: ServedDevice
    known: tuple[_Known, ...]
    on_the_wire: float | None

    @classmethod
    def of(cls, poll: Poll, device: ServedDevice, start: float) -> Standing:
        """`start` is when the first of its periods is reckoned from."""
        said = start + poll.phase
        known = tuple(_Known(poll.name, point, poll.every, said) for point in poll.group)
        one = wire_time(device.target.settings, poll.sizes) if len(poll.sizes) == 1 else None
        return cls(poll, device, known, one)


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
        self.missed = 0
        self._port = port
        self._health = health
        self._on_reading = on_reading
        self._loop = asyncio.get_running_loop()
        self._now = self._loop.time
        self._ended: asyncio.Future[None] = self._loop.create_future()
        start = self._now()
        self._schedule = Schedule(plan, start)
        self._polls = [Standing.of(poll, devices[poll.name], start) for poll in plan.polls]
        self.names = {poll.name for poll in plan.polls}

    async def run(self) -> None:
        """Until it is cancelled or ended; raises what `on_reading` raises."""
        tasks = [asyncio.create_task(self._work()), asyncio.create_task(self._watch_ages())]
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

    def cheapest(self, name: str) -> Standing | None:
        """The poll of a device that takes the line for the shortest time."""
        polls = [one for one in self._polls if one.poll.name == name]
        return min(polls, key=lambda one: one.poll.seconds, default=None)

    async def ask(self, standing: Standing, priority: Priority) -> Error | None:
        """Read one poll's points, and say what came. Returns why none did."""
        device, known = standing.device, standing.known
        try:
            readings = await device.poll_group(standing.poll.group, priority)
        except Error as error:
            self._say(known, quality_of(error), error)
            return error
        if standing.on_the_wire is not None:
            device.notice_delay(readings[0].ms / 1000 - standing.on_the_wire)
        for one, reading in zip(known, readings, strict=True):
            one.reading = reading
        self._say(known, Quality.GOOD)
        return None

    async def _work(self) -> None:
        """One poll after the other, each when it is due."""
        schedule, now = self._schedule, self._now
        while True:
            due = schedule.take(now())
            if due is None:
                await asyncio.sleep(schedule.deadline - now())
                continue
            await self._poll(self._polls[due.place])
            self.missed += schedule.finish(due, now())

    async def _poll(self, standing: Standing) -> None:
        """Ask, unless it is known that no answer can come."""
        poll = standing.poll
        if self._port.lost is not None:
            self._say(standing.known, Quality.PORT_LOST, self._port.lost)
            await asyncio.sleep(poll.seconds)
        elif self._health.silent_since(poll.name) is not None:
            self._say(standing.known, Quality.NO_REPLY, standing.device.last_error)
            nobody = self.names <= set(self._health.silent)
            await asyncio.sleep(poll.seconds if nobody else 0.0)
        else:
            await self.ask(standing, Priority.POLL)

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
            late = [
                known
                for standing in self._polls
                for known in standing.known
                if not known.stale and now - known.said > STALE_AFTER * known.every + 1.0
            ]
            self._say(late, Quality.STALE)

    def _say(self, points: Sequence[_Known], quality: Quality, error: Error | None = None) -> None:
        now, time = self._now(), datetime.now(UTC)
        stale = quality is Quality.STALE
        for one in points:
            one.said, one.stale = now, stale
            if self._ended.done():
                continue  # nobody listens any more
            try:
                self._on_reading(Polled(one.device, one.point, quality, time, one.reading, error))
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
