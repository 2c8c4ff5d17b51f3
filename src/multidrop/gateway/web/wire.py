"""The frames of one line as they pass, decoded, for whoever looks at the page now.

Nobody listens to a line that nobody looks at.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from typing import Any

from multidrop.gateway.line import GatewayLine
from multidrop.gateway.web.shapes import utc
from multidrop.observer import Found, Observer
from multidrop.transaction import Damage, Heard, Stray, shown

MOST_WAITING = 500
"""Transactions for a listener who is slow; the oldest go first, and are counted."""

TOGETHER = 0.1
"""s that transactions wait for others."""


class Watch:
    """One listener of one line."""

    def __init__(self, line: GatewayLine) -> None:
        self._service = line.service
        target = line.service.target
        self._shown = target.protocol.shown
        self._names = {device.device.address: device.name for device in line.devices}
        profiles = {
            device.device.address: device.profile
            for device in line.devices
            if device.device.address is not None
        }
        self._observer = Observer(
            target.protocol, target.settings, profiles, network="://" in target.port
        )
        self._loop = asyncio.get_running_loop()
        self._found: deque[dict[str, Any]] = deque(maxlen=MOST_WAITING)
        self._wake = asyncio.Event()
        self._begun = False
        self.left_out = 0

    async def pieces(self) -> AsyncIterator[list[dict[str, Any]]]:
        """What passed, a few times a second; an empty list once a second where nothing did."""
        self._service.taps.append(self._tap)
        try:
            while True:
                yield self._take()
                await self._something()
        finally:
            self._service.taps.remove(self._tap)

    def _tap(self, data: bytes, sent: bool, now: float, damaged: bool) -> None:
        """From the first question on: the answer to one that nobody listened to is no stray."""
        self._begun = self._begun or sent
        if not self._begun:
            return
        self._keep(self._observer.receive_data(data, now, sent=sent, damaged=damaged))

    async def _something(self) -> None:
        now = self._loop.time()
        self._wake.clear()
        timeout = max(TOGETHER, min(1.0, self._observer.deadline - now))
        waiting = asyncio.ensure_future(self._wake.wait())
        try:
            await asyncio.wait([waiting], timeout=timeout)
        finally:
            waiting.cancel()
        if self._found:
            await asyncio.sleep(TOGETHER)
        self._keep(self._observer.time_passed(self._loop.time()))

    def _keep(self, found: list[Found]) -> None:
        for item in found:
            self.left_out += len(self._found) == MOST_WAITING
            self._found.append(self._shape(item))
        if found:
            self._wake.set()

    def _take(self) -> list[dict[str, Any]]:
        taken = list(self._found)
        self._found.clear()
        return taken

    def _shape(self, found: Found) -> dict[str, Any]:
        """A transaction, a stray frame or damage, all with the same fields."""
        if isinstance(found, Damage):
            return self._row(
                "damage", found.reason, found.at, frames=[self._frame(found.raw, found.sent)]
            )
        if isinstance(found, Stray):
            heard = found.heard
            address = getattr(heard.frame, "address", None)
            return self._row(
                "stray", found.text, heard.end, address=address, frames=[self._heard(heard)]
            )
        meaning = found.meaning
        return self._row(
            meaning.kind.value,
            meaning.text,
            found.frames[0].start,
            address=found.address,
            answered=len(found.frames) > 1,
            answer_ms=found.answer_ms,
            fault=meaning.fault,
            refusal=None if meaning.refusal is None else meaning.refusal.text,
            values=[
                {"point": point.name or point.text, "value": shown(point, sample)}
                for point, sample in meaning.values
            ],
            frames=[self._heard(heard) for heard in found.frames],
        )

    def _row(self, kind: str, text: str, at: float, **more: Any) -> dict[str, Any]:
        time = datetime.now(UTC) - timedelta(seconds=self._loop.time() - at)
        address = more.get("address")
        return {
            "time": utc(time),
            "kind": kind,
            "text": text,
            "address": None,
            "device": self._names.get(address),
            "answered": None,
            "answer_ms": None,
            "fault": None,
            "refusal": None,
            "values": [],
            "frames": [],
            **more,
        }

    def _heard(self, heard: Heard) -> dict[str, Any]:
        return self._frame(heard.raw, heard.sent)

    def _frame(self, raw: bytes, sent: bool | None) -> dict[str, Any]:
        return {"sent": sent, "raw": raw.hex(), "shown": self._shown(raw)}
