"""The gateway: all lines of a plant, the latest of every point, and the parts that serve them.

::

    async with Gateway(plant, settings_of(plant)) as gateway:
        gateway.values.listeners.append(print)
        await gateway.run()
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

from multidrop.errors import Error, OutcomeUnknown, PortError
from multidrop.gateway.check import demand_right
from multidrop.gateway.clock import synchronised
from multidrop.gateway.fault_watch import FaultWatch
from multidrop.gateway.line import DeviceHealth, GatewayLine, LineHealth
from multidrop.gateway.parts import modules_of
from multidrop.gateway.permission import NotAllowed, Rates, allowed, check_value, number
from multidrop.gateway.polled import role_of
from multidrop.gateway.settings import Settings
from multidrop.gateway.telling import Telling
from multidrop.gateway.values import Values
from multidrop.io.audit import AuditLog, jsonable
from multidrop.plant import Plant, PlantDevice
from multidrop.points import Reading, Value
from multidrop.writing import Outcome, Written

STOPPING = 5.0
"""s that a write that is under way has to end when the gateway stops."""


class Part(Protocol):
    """Something that lives with the gateway: history, the page, a broker, a server."""

    name: str

    async def run(self) -> None:
        """Until cancelled; it is never started again. What it raises ends the gateway."""
        ...


PartT = TypeVar("PartT")


@dataclass(frozen=True, slots=True)
class Reloaded:
    """Names of the lines that a reload started, changed with their port open, stopped, and left alone."""

    started: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    stopped: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()


class Gateway:
    """A plant that is polled. Use it in an `async with`; add its `parts` before.

    `say` is told where a part listens, `news` what a log should have: a trip, a disk that is full.
    """

    def __init__(
        self,
        plant: Plant,
        settings: Settings | None = None,
        *,
        audit: AuditLog | None = None,
        say: Callable[[str], None] = lambda text: None,
        news: Callable[[str], None] = lambda text: None,
    ) -> None:
        demand_right(plant)
        self.plant = plant
        self.settings = settings or Settings()
        self.say = say
        self.news = news
        self.audit = audit or AuditLog(origin="gateway")
        self.values = Values(asyncio.get_running_loop().time, synchronised)
        self.faults = FaultWatch()
        self.values.listeners.append(self.faults.take)
        self.lines: dict[str, GatewayLine] = {}
        self.parts: dict[str, Part] = {}
        self.on_line: list[Callable[[GatewayLine], None]] = []
        self._rates = Rates()
        self._writing: set[asyncio.Task[Any]] = set()
        self._stopping = False
        self._changing = False  # lines are of one plant already, and limits still of the other
        self._reloading = asyncio.Lock()
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def add(self, part: Part) -> None:
        """A part, before the gateway is started; those that others need come first."""
        self.parts[part.name] = part

    def add_parts(self) -> None:
        """All that its plant file switches on. Raises `UsageError`, and `PortError` where a disk is full."""
        for module in modules_of(self.plant, self.settings):
            self.add(module.part(self))

    def part(self, kind: type[PartT]) -> PartT | None:
        """The part of this class; None where it is off."""
        return next((part for part in self.parts.values() if isinstance(part, kind)), None)

    # -- its life ----------------------------------------------------------------------------

    async def __aenter__(self) -> Self:
        for name, part in self.parts.items():
            self._start(f"part {name}", part.run())
        for name in self.plant.lines:
            self._start_line(name, self.plant)
        return self

    async def run(self) -> None:
        """Until cancelled; raises what a line or a part raised."""
        await asyncio.shield(self._ended)

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Let writes end, then stop the lines, then the parts: they keep what came last."""
        self._stopping = True
        if self._writing:
            await asyncio.wait(self._writing, timeout=STOPPING)
        await self._stop([f"line {name}" for name in self.lines])
        await self._stop([f"part {name}" for name in reversed(self.parts)])
        self._ended.cancel()

    def _start(self, name: str, work: Coroutine[Any, Any, None]) -> None:
        task = self._tasks[name] = asyncio.create_task(work, name=name)
        task.add_done_callback(self._has_ended)

    def _has_ended(self, task: asyncio.Task[None]) -> None:
        """What went wrong in a line or a part ends the gateway."""
        if task.cancelled() or task.exception() is None or self._ended.done():
            return
        error = task.exception()
        assert error is not None
        error.add_note(f"in {task.get_name()} of the gateway")
        self._ended.set_exception(error)

    async def _stop(self, names: list[str]) -> None:
        tasks = [self._tasks.pop(name) for name in names if name in self._tasks]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _start_line(self, name: str, plant: Plant) -> None:
        line = GatewayLine(name, plant.on(name), self.audit, self.values.take)
        self.lines[name] = line
        for told in self.on_line:
            told(line)
        self._start(f"line {name}", line.run())

    async def reload(self, plant: Plant) -> Reloaded:
        """Another plant. Lines that did not change go on, untouched; others on the same port keep it.

        Raises `UsageError` with all that is wrong; then nothing has changed.
        """
        async with self._reloading:
            await asyncio.to_thread(demand_right, plant)  # a second for thousands of points
            found = self._compared(plant)
            self._changing = True
            try:
                await self._change(plant, found)
            finally:
                self._changing = False
        return found

    def _compared(self, plant: Plant) -> Reloaded:
        """What becomes of each line; one that is opened anew counts as started."""
        started, changed, kept = [], [], []
        for name in plant.lines:
            devices, line = plant.on(name), self.lines.get(name)
            if line is not None and line.devices == tuple(devices):
                kept.append(name)
            elif line is not None and line.fits(devices):
                changed.append(name)
            else:
                started.append(name)
        stopped = (name for name in self.lines if name not in plant.lines)
        return Reloaded(tuple(started), tuple(changed), tuple(stopped), tuple(kept))

    async def _change(self, plant: Plant, found: Reloaded) -> None:
        ended = [name for name in (*found.stopped, *found.started) if name in self.lines]
        await self._stop([f"line {name}" for name in ended])
        for name in ended:
            del self.lines[name]
        for name in found.changed:
            await self.lines[name].change(plant.on(name))
        for name in found.started:
            self._start_line(name, plant)
        self.plant = plant
        points = {key: at for line in self.lines.values() for key, at in line.points.items()}
        self.values.keep_only(points)
        self.faults.keep_only(points)

    # -- asking ------------------------------------------------------------------------------

    def device(self, name: str) -> PlantDevice:
        """Raises `UsageError` with the nearest one."""
        return self.plant.find(name)

    def line_of(self, device: str) -> GatewayLine:
        """The line that a device is on. Raises `UsageError`, and `PortError` while that is started anew."""
        name = self.device(device).line
        if name not in self.lines:
            raise PortError(f"line {name} is not open now")
        return self.lines[name]

    async def read(self, device: str, point: str) -> Reading:
        """Read a point now, polled or not. Raises as a connection does."""
        line = self.line_of(device)
        return await line.service.device(device).read(point)

    async def write(
        self, device: str, point: str, value: Value | str, *, who: str, origin: str
    ) -> Written:
        """The one way in which anything over a network writes.

        Only what the plant allows: `NotAllowed` says why not, before anything is sent.
        Done, refused or failed, it is in the audit log with `who` and from where (`origin`).
        Raises as a connection's `write` does.
        """
        log = self.audit.of(who, origin)
        writing = asyncio.create_task(self._write(device, point, number(value), log))
        self._writing.add(writing)
        writing.add_done_callback(self._written)
        return await asyncio.shield(writing)  # who asked may go away: what is begun is ended

    async def _write(self, device: str, point: str, value: Value | str, log: AuditLog) -> Written:
        """Write, and leave one line in the log, whatever comes of it."""
        try:
            self._allow(device, point, value)
            service = self.line_of(device).service
            return await service.write(device, point, value, audit=log)
        except OutcomeUnknown:  # it was sent, also where the log could not take that
            raise
        except Error as error:
            if not log.lines:
                self._not_sent(log, device, point, value, str(error))
            raise

    def refuse(
        self, device: str, point: str, value: Value | str, why: str, *, who: str, origin: str
    ) -> None:
        """Log a write that a part refuses before it comes this far."""
        self._not_sent(self.audit.of(who, origin), device, point, value, why)

    def _not_sent(
        self, log: AuditLog, device: str, point: str, value: Value | str, why: str
    ) -> None:
        known = self.plant.devices.get(device)
        with contextlib.suppress(OSError):
            log.append(
                str(known.device) if known else device,
                point,
                asked=jsonable(value),
                outcome=Outcome.NOT_SENT.value,
                error=why,
            )

    def _written(self, writing: asyncio.Task[Written]) -> None:
        self._writing.discard(writing)
        if not writing.cancelled():
            writing.exception()  # known, also where nobody waits for it any more

    def _allow(self, device: str, point: str, value: Value | str) -> None:
        """Raises `UsageError` where a write must not be."""
        if self._stopping:
            raise NotAllowed("the gateway is stopping")
        if self._changing:
            raise PortError("nothing is written while the plant file is being read again")
        found = self.device(device)
        limits = allowed(found, point, lambda: role_of(found, point))
        prepared = self.line_of(device).service.device(device).device.prepare_write(point, value)
        check_value(f"{device} {point}", prepared.value, limits)
        self._rates.take(device, point, limits.rate, asyncio.get_running_loop().time())

    # -- how it is ---------------------------------------------------------------------------

    def line_health(self) -> list[LineHealth]:
        return [line.health() for line in self.lines.values()]

    def telling(self) -> list[Telling]:
        """The parts that tell how they are."""
        return [part for part in self.parts.values() if isinstance(part, Telling)]

    def device_health(self, name: str) -> DeviceHealth:
        """Raises `UsageError`."""
        return self.line_of(name).device_health(name, self.faults.state(name))
