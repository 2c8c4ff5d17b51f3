"""Backups of devices while they are polled, what they hold now, and what two of these differ in.

A backup reads, in the turns that the polls leave over, and puts one file into a folder.
Nothing here writes to a device: a passport is restored on the command line alone.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from multidrop.errors import Error, UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.polled import target_of
from multidrop.gateway.settings import (
    PassportSettings,
    Settings,
    demand_writable,
    objections,
)
from multidrop.io.served import ServedDevice
from multidrop.passports.backup import load
from multidrop.passports.difference import Difference, differences
from multidrop.passports.folder import Index, Listed, save_as_new
from multidrop.passports.passport import Passport
from multidrop.passports.served_backup import ServedBackup
from multidrop.plant import Plant

MOST_HELD = 32
"""Devices of which the gateway remembers all that they held when it was read last."""


class Busy(UsageError):
    """All of this device is being read already."""

    kind = "busy"


class NotKept(UsageError):
    """The folder does not take a passport, or cannot be read."""

    kind = "not-kept"


class NoPassport(UsageError):
    """There is none of this name, or the device was not read yet."""

    kind = "request"


class _Stopped(Exception):
    """Somebody has had enough."""


class State(StrEnum):
    """How far a reading of all points has come."""

    READING = "reading"
    DONE = "done"
    STOPPED = "stopped"  # by somebody
    FAILED = "failed"


@dataclass(slots=True)
class Taking:
    """All of a device is being read, or was: `done` of `points` were asked for.

    `keep` is whether a file is made of it, and `name` that file's. `who` began it,
    None where nobody had to say who he is. Times are UTC.
    """

    device: str
    keep: bool
    who: str | None
    points: int
    started: datetime
    done: int = 0
    state: State = State.READING
    ended: datetime | None = None
    name: str | None = None
    unreadable: int = 0
    error: str | None = None
    stopping: bool = False
    task: asyncio.Task[None] | None = field(default=None, repr=False)


def part(gateway: Gateway) -> Passports:
    """The part of `[passports]`. Raises `UsageError` where nothing can be kept."""
    assert gateway.settings.passports is not None
    return Passports(gateway, gateway.settings.passports)


def wrong(plant: Plant, settings: Settings) -> Iterator[str]:
    """What is wrong with `[passports]`."""
    assert settings.passports is not None
    path = settings.path(settings.passports.path)
    return objections(lambda: demand_writable("passports.path", path, folder=True))


class Passports:
    """The passports of a plant, and the readings of all points that are under way: one of each device."""

    name = "passports"

    def __init__(self, gateway: Gateway, settings: PassportSettings) -> None:
        self.folder = gateway.settings.path(settings.path)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(
                f"passports cannot be kept in {self.folder}: {error.strerror}"
            ) from None
        self.takings: dict[str, Taking] = {}
        self._gateway = gateway
        self._most = settings.most
        self._index = Index(self.folder)
        self._looking = asyncio.Lock()
        self._held: dict[str, Passport] = {}  # the newest of each device, the newest last

    async def run(self) -> None:
        """Until cancelled; then nothing is read any more."""
        try:
            await asyncio.Event().wait()
        finally:
            tasks = [taking.task for taking in self.takings.values() if taking.task is not None]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    # -- reading all of a device -------------------------------------------------------------

    async def take(self, device: str, *, keep: bool, who: str | None) -> Taking:
        """Begin to read all points of a device; `keep` makes a passport of them.

        Raises `Busy`, `NotKept`, `PortError`, and `UsageError` where there is nothing to read.
        """
        if keep:
            await self._demand_room(device)
        running = self.takings.get(device)
        if running is not None and running.state is State.READING:
            raise Busy(f"{device} is being read already: {running.done} of {running.points} points")
        served = self._gateway.line_of(device).service.device(device)
        backup = ServedBackup.of(served)
        _ = served.line  # while the port is away nothing is begun
        taking = Taking(device, keep, who, len(backup.points), datetime.now(UTC))
        self.takings[device] = taking
        taking.task = asyncio.create_task(self._take(taking, backup), name=f"backup of {device}")
        return taking

    async def _demand_room(self, device: str) -> None:
        """Before a byte is sent."""
        if not os.access(self.folder, os.W_OK):
            raise NotKept(f"passports cannot be kept in {self.folder}: it is not writable")
        if len(await self.listed(device)) >= self._most:
            raise NotKept(
                f"{self.folder} has {self._most} passports of {device} already, and none is deleted"
                " from here: move some of them elsewhere"
            )

    async def _take(self, taking: Taking, backup: ServedBackup) -> None:
        try:
            await self._read(taking, backup)
            made = backup.passport()
            taking.unreadable = len(made.unreadable)
            if taking.keep:
                path = await asyncio.to_thread(save_as_new, made, taking.device, self.folder)
                taking.name = path.name
                self._gateway.news(
                    f"{taking.device}: passport {path.name}, made by {taking.who or 'somebody'}"
                )
            self._hold(taking.device, made)
            self._end(taking, State.DONE)
        except _Stopped:
            self._end(taking, State.STOPPED)
        except Error as error:
            self._end(taking, State.FAILED, str(error))
        finally:
            if taking.state is State.READING:
                self._end(taking, State.FAILED, "it was broken off")

    async def _read(self, taking: Taking, backup: ServedBackup) -> None:
        """Between two questions it may be stopped: none is left without its answer."""
        async for done in backup.run():
            taking.done = done
            if taking.stopping:
                raise _Stopped
            if not self._is_still_there(taking.device, backup.connection):
                raise UsageError("the plant file was read again, and has another device there now")

    def _is_still_there(self, device: str, served: ServedDevice) -> bool:
        line = self._gateway.plant.devices.get(device)
        running = None if line is None else self._gateway.lines.get(line.line)
        return running is not None and running.service.devices.get(device) is served

    def _end(self, taking: Taking, state: State, error: str | None = None) -> None:
        taking.state, taking.error, taking.ended = state, error, datetime.now(UTC)

    def _hold(self, device: str, made: Passport) -> None:
        self._held.pop(device, None)
        self._held[device] = made
        while len(self._held) > MOST_HELD:
            del self._held[next(iter(self._held))]

    async def stop(self, device: str) -> Taking:
        """Stop reading a device behind the question that is under way; what was read is forgotten.

        Raises `NoPassport` where nothing is read.
        """
        taking = self.takings.get(device)
        if taking is None or taking.state is not State.READING or taking.task is None:
            raise NoPassport(f"{device} is not being read")
        taking.stopping = True
        await asyncio.wait([taking.task])
        return taking

    # -- what is kept ------------------------------------------------------------------------

    async def listed(self, device: str) -> list[Listed]:
        """The passports of a device, the newest first. Raises `NotKept`."""
        found = self._gateway.device(device)
        others = frozenset(
            str(other.device)
            for other in self._gateway.plant.devices.values()
            if other.name != device
        )
        try:
            async with self._looking:
                listed = await asyncio.to_thread(self._index.listed)
        except OSError as error:
            raise NotKept(f"{self.folder} cannot be read: {error.strerror}") from None
        target = target_of(found)
        return [item for item in listed if item.is_of(device, target, others)]

    async def path(self, device: str, name: str) -> Path:
        """The file of a device's passport, by its name in the list. Raises `NoPassport`."""
        for item in await self.listed(device):
            if item.path.name == name and item.device:
                return item.path
        raise NoPassport(f"{device} has no passport {name!r}")

    def held(self, device: str) -> Passport:
        """What a device held when all of it was read last. Raises `NoPassport`."""
        found = self._held.get(device)
        if found is None or found.device != str(self._gateway.device(device).device):
            raise NoPassport(f"{device} was not read yet: POST /api/read-all reads it")
        return found

    async def compared(
        self, device: str, before: str, after: str | None, *, everything: bool
    ) -> tuple[Passport, Passport, list[Difference]]:
        """Two passports of a device and what they differ in; `after` None is what it held last.

        Raises `NoPassport`, and `UsageError` for one that is damaged.
        """
        paths = [await self.path(device, name) for name in (before, after) if name is not None]
        later = self.held(device) if after is None else None
        passports = [await asyncio.to_thread(load, path) for path in paths]
        one, other = passports[0], later or passports[1]
        return one, other, list(differences(one, other, everything=everything))
