"""A line of the plant: its service, what is polled on it, and how its devices are."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from functools import partial
from typing import Any

from multidrop.gateway.polled import at_one_place, polled, targets_of
from multidrop.io.audit import AuditLog
from multidrop.io.line import Timed
from multidrop.io.poller import OnReading, Polled, Quality
from multidrop.io.polling import TYPICAL_DELAY, Plan, line_time
from multidrop.io.service import LineService, one_line, settings_of_line
from multidrop.plant import PlantDevice
from multidrop.points import Point
from multidrop.writing import Written


@dataclass(frozen=True, slots=True)
class LineHealth:
    """A line now. `planned` and `load` are shares of its time, 0..1; `lost` says why the port is away."""

    name: str
    port: str
    protocol: str
    settings: str
    lost: str | None
    times_opened: int
    planned: float
    load: float
    missed: int
    counters: dict[str, Any]


@dataclass(frozen=True, slots=True)
class DeviceHealth:
    """A device now. `silent` is whether it does not answer, `delay` its answer delay in s.

    `fault` is what it said last, None where it says nothing of faults.
    """

    name: str
    line: str
    profile: str
    title: str
    address: int | None
    points: int
    silent: bool
    fault: bool | None
    delay: float | None
    counters: dict[str, Any]


class Fullness:
    """The load of a plan, by the answer delays as they are now: `plan.learned(delays).load`.

    That makes a plan anew, which takes milliseconds; a page asks once a second.
    """

    def __init__(self, plan: Plan) -> None:
        self._delays = plan.delays
        self._undelayed = 0.0
        self._asked: dict[str, float] = {}  # device -> messages a second
        for poll in plan.polls:
            self._undelayed += line_time(plan.settings, poll.sizes, 0.0) / poll.every
            asked = self._asked.get(poll.name, 0.0)
            self._asked[poll.name] = asked + len(poll.sizes) / poll.every

    def share(self, delays: Mapping[str, float]) -> float:
        """0..1, and more. `delays` are the measured ones, s, by the device's name."""
        known = {**self._delays, **delays}
        delayed = (asked * known.get(name, TYPICAL_DELAY) for name, asked in self._asked.items())
        return self._undelayed + sum(delayed)


class GatewayLine:
    """One line, polled while `run` runs. The port stays open while only its devices change."""

    def __init__(
        self, name: str, devices: Sequence[PlantDevice], audit: AuditLog, on_reading: OnReading
    ) -> None:
        self.name = name
        self.service = LineService(targets_of(devices), audit=audit)
        self._take(devices)
        self._on_reading = on_reading
        self._polling: asyncio.Task[None] | None = None
        self._turn = asyncio.Lock()  # to start polling, or to change what is polled
        self._listen_to_writes()

    def _listen_to_writes(self) -> None:
        for name, served in self.service.devices.items():
            served.on_written = partial(self._written, name)

    def _written(self, name: str, timed: Timed[Written]) -> None:
        """What a write has found is the newest of all that is polled at its place, by any name."""
        written, found = timed.result.point, timed.result.found
        if found is None:
            return
        polls = (poll for poll in self.plan.polls if poll.name == name)
        there = [point for poll in polls for point in poll.group if at_one_place(point, written)]
        if not there:
            return  # the device has gone with a reload, say
        read = Timed([found] * len(there), timed.received_at, timed.seconds)
        readings = self.service.device(name).readings(there, read)
        for point, reading in zip(there, readings, strict=True):
            self._on_reading(Polled(name, point, Quality.GOOD, datetime.now(UTC), reading))

    def _take(self, devices: Sequence[PlantDevice]) -> None:
        """What is polled of these devices, which the service knows."""
        self.devices = tuple(devices)
        self._device = {device.name: device for device in devices}
        self._polled = {device.name: polled(device) for device in devices}
        self.plan = self.service.plan(
            (name, point, every)
            for name, points in self._polled.items()
            for point, every in points.items()
        )
        self._fullness = Fullness(self.plan)

    async def run(self) -> None:
        """Open the port, and poll until cancelled. Raises `UsageError` for a port that is none."""
        async with self.service:
            while True:
                async with self._turn:
                    polling = self._polling = asyncio.create_task(
                        self.service.poll(self.plan, self._on_reading)
                    )
                try:
                    await asyncio.wait([polling])
                finally:
                    polling.cancel()
                    await asyncio.gather(polling, return_exceptions=True)
                if not polling.cancelled():
                    polling.result()

    def fits(self, devices: Sequence[PlantDevice]) -> bool:
        """Whether these devices are on the same port with the same settings."""
        targets = targets_of(devices)
        return settings_of_line(one_line(targets)) == settings_of_line(self.service.target)

    async def change(self, devices: Sequence[PlantDevice]) -> None:
        """Other devices or points on the open port. Raises `UsageError`."""
        async with self._turn:
            if self._polling is not None:
                self._polling.cancel()
                await asyncio.wait([self._polling])
            self.service.change(targets_of(devices))
            self._take(devices)
            self._listen_to_writes()

    @property
    def keys(self) -> list[tuple[str, str]]:
        """Device and point of everything that is polled."""
        return [(name, point) for name, points in self._polled.items() for point in points]

    @property
    def points(self) -> dict[tuple[str, str], Point]:
        """The same, each with the place it is read at."""
        return {
            (poll.name, point.name or point.text): point
            for poll in self.plan.polls
            for point in poll.group
        }

    def health(self) -> LineHealth:
        service = self.service
        settings = service.target.settings
        return LineHealth(
            self.name,
            service.target.port,
            service.target.protocol.name,
            f"{settings.baud} {settings.format}",
            None if service.lost is None else str(service.lost),
            service.times_opened,
            self._fullness.share(service.delays),
            service.load,
            service.missed,
            plain(service.counters),
        )

    def device_health(self, name: str, fault: bool | None) -> DeviceHealth:
        device = self._device[name]
        served = self.service.device(name)
        return DeviceHealth(
            name,
            self.name,
            device.profile.name,
            device.profile.title,
            device.device.address,
            len(self._polled[name]),
            self.service.health.silent_since(name) is not None,
            fault,
            served.counters.delay,
            plain(served.counters),
        )


def plain(item: Any) -> dict[str, Any]:
    """A dataclass with nothing inside that could change, as a dict: `asdict` copies it all."""
    return {field.name: getattr(item, field.name) for field in fields(item)}
