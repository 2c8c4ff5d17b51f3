"""Keeps a freeze-frame when a device trips: why it did, at three in the morning."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from multidrop.errors import Error, NoReply, PortError, UsageError
from multidrop.gateway.fault_watch import Change, FaultChange
from multidrop.gateway.faults.freeze_frames import FreezeFrame, FreezeFrames
from multidrop.gateway.faults.recent import (
    Past,
    Piece,
    RecentFrames,
    RecentValues,
    frames_of,
    shown_time,
)
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.line import GatewayLine
from multidrop.gateway.settings import FaultSettings, Settings, demand_writable, objections
from multidrop.gateway.values import Update
from multidrop.io.audit import jsonable
from multidrop.io.connection import Target
from multidrop.io.cutting import WallClock
from multidrop.plant import Plant
from multidrop.points import Reading


def part(gateway: Gateway) -> Faults:
    """The part of `[faults]`. Raises `UsageError` where nothing can be kept."""
    assert gateway.settings.faults is not None
    return Faults(gateway, gateway.settings.faults)


def wrong(plant: Plant, settings: Settings) -> Iterator[str]:
    """What is wrong with `[faults]`."""
    assert settings.faults is not None
    path = settings.path(settings.faults.path)
    return objections(lambda: demand_writable("faults.path", path, folder=True))


@dataclass(frozen=True, slots=True)
class _Heard:
    """A change, and what was kept of the time before it."""

    change: FaultChange
    frame: FreezeFrame
    pieces: list[Piece]


class Faults:
    """Hears of every trip. What was before is taken at once; status and points are read then."""

    name = "faults"

    def __init__(self, gateway: Gateway, settings: FaultSettings) -> None:
        self.kept = FreezeFrames(gateway.settings.path(settings.path), settings.keep)
        self.kept.check()
        self._gateway = gateway
        self._most = settings.frames
        self._values = RecentValues(settings.seconds)
        self._frames: dict[str, RecentFrames] = {}
        self._changes: asyncio.Queue[_Heard] = asyncio.Queue()
        self._turns: dict[str, asyncio.Lock] = {}  # of a device: one change after the other
        self._wall = WallClock()
        gateway.values.listeners.insert(0, self._values.take)  # before who asks for them
        gateway.on_line.append(self._tap)
        gateway.faults.listeners.append(self._heard)

    def _tap(self, line: GatewayLine) -> None:
        ring = self._frames[line.name] = RecentFrames(self._most)
        line.service.taps.append(ring)

    def _heard(self, change: FaultChange) -> None:
        """In the loop, right behind the answer that said it: what was before is all still there."""
        if change.change is Change.CLEAR:
            self._changes.put_nowait(_Heard(change, {}, []))
        else:
            ring = self._frames[self._gateway.device(change.device).line]
            self._changes.put_nowait(_Heard(change, self._before(change), ring.pieces()))

    def _before(self, change: FaultChange) -> FreezeFrame:
        target = self._target(change.device)
        update, reading = change.update, change.update.polled.reading
        assert reading is not None
        return {
            "v": 1,
            "device": change.device,
            "name": str(target.name),
            "time": shown_time(reading.time),
            "synchronised": update.synchronised,
            "found": change.change is Change.FOUND,
            "said_by": update.point,
            "cleared": None,
            "status": None,
            "status_lines": [],
            "status_error": None,
            "before": [_value(past, update) for past in self._values.of(change.device)],
            "read": [],
            "frames": [],
        }

    def _target(self, device: str) -> Target:
        return self._gateway.line_of(device).service.device(device).target

    async def run(self) -> None:
        """Keep them until cancelled. A disk that is full ends nothing."""
        collecting: set[asyncio.Task[None]] = set()
        try:
            while True:
                task = asyncio.create_task(self._keep(await self._changes.get()))
                collecting.add(task)
                task.add_done_callback(collecting.discard)
        finally:
            for task in collecting:
                task.cancel()
            await asyncio.gather(*collecting, return_exceptions=True)

    async def _keep(self, heard: _Heard) -> None:
        device = heard.change.device
        async with self._turns.setdefault(device, asyncio.Lock()):
            try:
                if heard.change.change is Change.CLEAR:
                    await self._clear(heard.change)
                elif not heard.frame["found"] or not await self._is_known(device):
                    await self._freeze(heard.frame, heard.pieces)
            except OSError as error:
                self._gateway.news(f"{device}: its freeze-frame cannot be kept: {error}")

    async def _is_known(self, device: str) -> bool:
        """Whether the fault that a device was found in was already there before the gateway started."""
        newest = await asyncio.to_thread(self.kept.newest, device)
        return newest is not None and newest["cleared"] is None

    async def _freeze(self, frame: FreezeFrame, pieces: list[Piece]) -> None:
        """What was before is safe at once; then what the device says now is added."""
        target = self._target(frame["device"])
        frame["frames"] = await asyncio.to_thread(
            frames_of, pieces, target.protocol, target.settings, self._most, self._wall
        )
        await asyncio.to_thread(self.kept.save, frame)
        await self._ask(frame)
        await asyncio.to_thread(self.kept.save, frame)
        code = (frame["status"] or {}).get("malfunction_code")
        known = "" if code is None else f", malfunction code {code:04X}h"
        self._gateway.news(f"{frame['device']}: FAULT{known}; freeze-frame {frame['time']}")

    async def _ask(self, frame: FreezeFrame) -> None:
        """Its status, and the points that the plant wants to know then."""
        try:
            device = self._gateway.line_of(frame["device"]).service.device(frame["device"])
            texts = self._gateway.device(frame["device"]).on_fault
            report = await device.status()
        except UsageError as error:  # it has no status, or is gone from the plant
            frame["status_error"] = str(error)
        except Error as error:
            frame["status_error"] = str(error)
            return
        else:
            frame["status"], frame["status_lines"] = report.fields, list(report.lines)
        for text in texts:
            for point in device.device.points(text):
                try:
                    frame["read"].append(_reading(point.name or text, await device.read(point)))
                except (NoReply, PortError) as error:
                    frame["read"].append({"point": point.name or text, "error": str(error)})
                    return  # nobody is there
                except Error as error:
                    frame["read"].append({"point": point.name or text, "error": str(error)})

    async def _clear(self, change: FaultChange) -> None:
        newest = await asyncio.to_thread(self.kept.newest, change.device)
        if newest is None or newest["cleared"] is not None:
            return
        reading = change.update.polled.reading
        assert reading is not None
        newest["cleared"] = shown_time(reading.time)
        await asyncio.to_thread(self.kept.save, newest)
        self._gateway.news(f"{change.device}: no fault any more")


def _value(past: Past, trip: Update) -> dict[str, Any]:
    return {
        "s": round(past.monotonic - trip.monotonic, 3),
        "point": past.point,
        "quality": past.quality,
        "value": jsonable(past.value),
        "unit": past.unit,
        "meaning": past.meaning,
    }


def _reading(name: str, reading: Reading) -> dict[str, Any]:
    return {
        "point": name,
        "value": jsonable(reading.value),
        "unit": reading.unit,
        "meaning": reading.meaning,
        "time": shown_time(reading.time),
    }
