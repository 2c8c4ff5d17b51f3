"""A line service: the one owner of a line with many devices, for programs that run for months.

::

    async with LineService({"infeed": "flexmax:0@/dev/ttyUSB0", ...}) as service:
        plan = service.plan([("infeed", ["actual_speed"], 0.5)])
        print(plan)                                     # 6 %
        async for polled in service.readings(plan):
            print(polled.device, polled.point, polled.value, polled.quality)

The port is opened again when it is lost. Silent devices are found out and probed;
docs/explanation/line-service.md says how.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Iterable, Mapping, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Self

from multidrop.errors import NoReply, PortError, UsageError
from multidrop.io.audit import AuditLog
from multidrop.io.connection import Target
from multidrop.io.health import Health, Load
from multidrop.io.kept_port import KeptPort
from multidrop.io.line import Tap
from multidrop.io.poller import OnReading, Polled, Polling, Quality, points_of
from multidrop.io.polling import Plan, Wanted
from multidrop.io.served import ServedDevice
from multidrop.io.turns import Priority
from multidrop.naming import DeviceName
from multidrop.points import Point, Reading, Value
from multidrop.profile import nearest
from multidrop.session import Counters
from multidrop.writing import Written


class LineService:
    """All devices of one line. Use it in an `async with`; it opens the port, or keeps trying to.

    `devices` are named as on the command line, by names of one's own or by
    themselves. Raises `UsageError` where they are not of one line.
    """

    def __init__(
        self,
        devices: Mapping[str, str | DeviceName | Target] | Iterable[str],
        *,
        audit: AuditLog | None = None,
    ) -> None:
        targets = _targets(devices)
        self.target = one_line(targets)
        self._audit = audit
        self.health = Health()
        self._load = Load()
        self._wake = asyncio.Event()
        self._port = KeptPort(self.target, self._wake.set)
        self.devices = {name: self._served(name, target) for name, target in targets.items()}
        self._pollings: list[Polling] = []
        self._tasks: list[asyncio.Task[None]] = []

    def _served(self, name: str, target: Target) -> ServedDevice:
        return ServedDevice(
            name, target, self._audit, self._port, self.health, self._load, self._wake.set
        )

    def change(self, devices: Mapping[str, str | DeviceName | Target] | Iterable[str]) -> None:
        """Other devices, or others of their points, on the open port. Nothing may be polled meanwhile.

        Raises `UsageError` where they are not of this line; then nothing has changed.
        """
        if self._pollings:
            raise UsageError("what is polled can only be changed once it is not")
        targets = _targets(devices)
        if settings_of_line(one_line(targets)) != settings_of_line(self.target):
            raise UsageError("these devices are of another line, or it has other settings")
        self.target = next(iter(targets.values()))
        known, self.devices = self.devices, {}
        for name, target in targets.items():
            device = known.get(name)
            same = device is not None and device.target.same(target)
            self.devices[name] = device if same and device else self._served(name, target)
        for name in set(known) - set(targets):
            self.health.heard(name)

    # -- the port ----------------------------------------------------------------------------

    @property
    def lost(self) -> PortError | None:
        """Why the port is away; None while it is open."""
        return self._port.lost

    @property
    def times_opened(self) -> int:
        return self._port.times_opened

    @property
    def taps(self) -> list[Tap]:
        """Called with every piece of bytes, also after the port was opened again."""
        return self._port.taps

    async def __aenter__(self) -> Self:
        """Returns when the port is open or the first attempt failed. Raises `UsageError`."""
        keeping = asyncio.create_task(self._port.keep_open())
        self._tasks = [keeping, asyncio.create_task(self._probe_the_silent())]
        for task in self._tasks:
            task.add_done_callback(self._broke)
        tried = asyncio.create_task(self._port.tried.wait())
        try:
            await asyncio.wait([keeping, tried], return_when=asyncio.FIRST_COMPLETED)
            if keeping.done():
                keeping.result()
        except BaseException:
            await self.close()
            raise
        finally:
            tried.cancel()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the port and end all polling; what is asked from now on raises `PortError`."""
        for polling in self._pollings:
            polling.end()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _broke(self, task: asyncio.Task[None]) -> None:
        """One of the service's own tasks ended: that is a bug, which must not pass for silence."""
        if not task.cancelled():
            for polling in self._pollings:
                polling.end(task.exception())

    # -- asking ------------------------------------------------------------------------------

    def device(self, name: str) -> ServedDevice:
        """A device, with the methods of an `AsyncConnection`. Raises `UsageError`."""
        if name not in self.devices:
            raise UsageError(f"this line has no device {name!r}{nearest(name, self.devices)}")
        return self.devices[name]

    async def read(
        self,
        name: str,
        points: str | Sequence[str | Point],
        priority: Priority = Priority.OPERATOR,
    ) -> list[Reading]:
        """Read points of a device now, also of a silent one. Raises as a connection does."""
        device = self.device(name)
        asked = points_of(device, points)
        found: dict[Point, Reading] = {}
        for group in device.device.plan(asked):
            readings = await device.read_group(group, priority=priority)
            found.update(zip(group, readings, strict=True))
        return [found[point] for point in asked]

    async def write(
        self,
        name: str,
        point: str,
        value: Value | str,
        *,
        verify: bool = True,
        force: bool = False,
        audit: AuditLog | None = None,
    ) -> Written:
        """Write one point, before everything else that waits; raises unless it is confirmed.

        `audit` is where that is recorded, if not in the log of the service.
        """
        device = self.device(name)
        return await device.write(point, value, verify=verify, force=force, audit=audit)

    async def try_now(self, name: str) -> bool:
        """Probe a device at once, silent or not. Returns whether it answered. Raises `PortError`."""
        device = self.device(name)
        for polling in self._pollings:
            poll = polling.cheapest(name)
            if poll is not None:
                error = await polling.ask(poll, Priority.OPERATOR)
                if isinstance(error, PortError):
                    raise error
                return not isinstance(error, NoReply)
        try:
            await device.status()
        except NoReply:
            return False
        return True

    # -- polling -----------------------------------------------------------------------------

    def plan(self, wanted: Iterable[tuple[str, str | Sequence[str | Point], float]]) -> Plan:
        """What to read how often: device, points, s. Reckoned with the delays measured so far."""
        return Plan(self.target.settings, self.wanted(wanted), self.delays)

    def wanted(
        self, wanted: Iterable[tuple[str, str | Sequence[str | Point], float]]
    ) -> list[Wanted]:
        """The same for `Plan.adding` and `Plan.with_more`. Raises `UsageError`."""
        found = []
        for name, texts, every in wanted:
            device = self.device(name)
            found.append(Wanted(name, device.device, points_of(device, texts), every))
        return found

    @property
    def delays(self) -> dict[str, float]:
        """Measured answer delays of the devices that have answered a poll, s."""
        known = {name: device.counters.delay for name, device in self.devices.items()}
        return {name: delay for name, delay in known.items() if delay is not None}

    async def poll(self, plan: Plan, on_reading: OnReading) -> None:
        """Poll until this is cancelled or the service closed; each poll of a point calls `on_reading`.

        Raises what `on_reading` raises; what goes wrong on the line is a `Quality`.
        """
        devices = {name: self.device(name) for name in {poll.name for poll in plan.polls}}
        polling = Polling(plan, devices, self._port, self.health, on_reading)
        self._pollings.append(polling)
        for device in devices.values():
            device.polled += 1
        try:
            await polling.run()
        finally:
            self._pollings.remove(polling)
            for name, device in devices.items():
                device.polled -= 1
                if not device.polled:
                    self.health.heard(name)  # nobody asks any more, so nobody needs a probe

    async def readings(self, plan: Plan) -> AsyncGenerator[Polled, None]:
        """The same as an iterator; end it with `contextlib.aclosing`, or with its task.

        Who is slower than the line gets the newest of each point, and none that is older.
        """
        newest: dict[tuple[str, Point], Polled] = {}
        news = asyncio.Event()

        def keep(polled: Polled) -> None:
            newest[polled.device, polled.point] = polled
            news.set()

        task = asyncio.create_task(self.poll(plan, keep))
        task.add_done_callback(lambda _: news.set())
        try:
            while newest or not task.done():
                while newest:
                    yield newest.pop(next(iter(newest)))
                news.clear()
                if not task.done():
                    await news.wait()
            task.result()
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    # -- what happens on the line --------------------------------------------------------------

    @property
    def counters(self) -> Counters:
        """Of the whole line, strangers included, over all the times that the port was open."""
        return self._port.counters

    @property
    def load(self) -> float:
        """The share of the last minute, 0..1, in which conversations held the line."""
        return self._load.share(asyncio.get_running_loop().time())

    @property
    def missed(self) -> int:
        """Polls that were left out because the line was too busy, in what is polled now."""
        return sum(polling.missed for polling in self._pollings)

    async def _probe_the_silent(self) -> None:
        now = asyncio.get_running_loop().time
        worst = _worst_probe(self.target)
        while True:
            probe = self.health.take(now(), worst) if self.lost is None else None
            if probe is None:
                self._wake.clear()
                until = self.health.deadline - now() if self.lost is None else None
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(None if until == float("inf") else until):
                        await self._wake.wait()
                continue
            device = self.devices[probe.name]
            busy = device.counters.busy
            polls = [(polling, polling.cheapest(probe.name)) for polling in self._pollings]
            for polling, poll in polls:
                if poll is not None:
                    await polling.ask(poll, Priority.BACKGROUND)
                    break
            self.health.probed(probe, device.counters.busy - busy)


def _targets(
    devices: Mapping[str, str | DeviceName | Target] | Iterable[str],
) -> dict[str, Target]:
    named = dict(devices) if isinstance(devices, Mapping) else {name: name for name in devices}
    return {name: Target.of(device) for name, device in named.items()}


def settings_of_line(target: Target) -> tuple[object, ...]:
    """What all devices of one line have in common: the port, and how it is used."""
    return target.port, target.settings, replace(target.options, own={})


def one_line(targets: Mapping[str, Target]) -> Target:
    """The first of devices that are on one line. Raises `UsageError` where they are not."""
    if not targets:
        raise UsageError("a line service needs at least one device")
    first, *others = targets.values()
    addresses = {first.name.address}
    for other in others:
        if other.port != first.port:
            raise UsageError(f"{other.name} and {first.name} are not on one port")
        if settings_of_line(other) != settings_of_line(first):
            raise UsageError(f"{other.name} and {first.name} differ in the settings of their line")
        if other.name.address in addresses:
            raise UsageError(f"{other.name}: there is another device at this address")
        addresses.add(other.name.address)
    return first


def _worst_probe(target: Target) -> float:
    """s that a probe may hold the line: question, time-out, and an answer that trickles in."""
    timing = target.settings.timing(network="://" in target.port)
    return timing.answer + 2 * (timing.longest_frame * timing.character + timing.silence)


__all__ = ["LineService", "Polled", "Quality"]
