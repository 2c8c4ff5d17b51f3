"""Cuts what passes on a line into frames, each with the time at which its last byte had passed."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

from multidrop.events import Damaged, FrameReceived
from multidrop.timing import LineSettings

FOREVER = float("inf")
MOST_DRIFT_NS = 10**9
EARLY = 0.2
"""Of a request's time: clocks differ by less."""


class Cut(NamedTuple):
    """A frame or a run of damaged bytes. `end` is monotonic, in s; `sent` None where nobody knows."""

    event: FrameReceived[Any] | Damaged
    sent: bool | None
    end: float
    marked: bool = False  # the port marked it as wrong


class Cutter:
    """What a master sends and hears, or with `passive` what somebody else's line carries.

    Several frames may arrive in one piece: the last one ends with it, those before
    end as much earlier as the bytes behind them take. A request ends when its bytes
    have had their time; where an answer (or an echo) is whole before that, as on a
    simulated line, its bytes took none. So it comes out with what follows it.
    """

    def __init__(
        self, settings: LineSettings, *, network: bool = False, passive: bool = False
    ) -> None:
        self._new_decoder = settings.decoder
        self._decoder = settings.decoder()
        self._silence = settings.timing(network=network).silence
        self._character = settings.character
        self._heard: bool | None = None if passive else False
        self._asked: list[tuple[Cut, float]] = []  # sent and not come out yet, and its start
        self._last = 0.0  # when a byte was heard last
        self._end = -FOREVER  # of what came out last

    @property
    def deadline(self) -> float:
        """When an unfinished frame is cut short; infinity where there is none."""
        return self._last + self._silence if self._decoder.pending else FOREVER

    def receive(self, data: bytes, now: float, *, damaged: bool = False) -> list[Cut]:
        """Bytes that were heard at `now`."""
        cuts = self.time_passed(now)
        self._last = now
        if damaged:
            return cuts + self._cut(self._decoder.line_error(data), now, marked=True)
        return cuts + self._cut(self._decoder.receive_data(data), now)

    def send(self, data: bytes, now: float) -> list[Cut]:
        """Bytes that began to leave at `now`."""
        cuts = self._cut(self._decoder.silence(), self._last) + self._release(FOREVER)
        decoder = self._new_decoder()
        for event in (*decoder.receive_data(data), *decoder.silence()):
            end = now + len(event.raw) * self._character
            self._asked.append((Cut(event, True, end), now))
            now = end
        return cuts

    def time_passed(self, now: float) -> list[Cut]:
        """A frame that nothing was added to until `now` is cut short."""
        return self._cut(self._decoder.silence(), self._last) if now >= self.deadline else []

    def finish(self) -> list[Cut]:
        """What is left."""
        return self._cut(self._decoder.silence(), self._last) + self._release(FOREVER)

    def _release(self, heard: float) -> list[Cut]:
        """What was sent, now that a frame was heard whole."""
        asked, self._asked = self._asked, []
        cuts = []
        for cut, start in asked:
            took_no_time = heard < cut.end - EARLY * (cut.end - start)
            end = start if took_no_time else min(cut.end, heard)
            cuts.append(self._after_others(cut._replace(end=end)))
        return cuts

    def _cut(
        self, events: list[FrameReceived[Any] | Damaged], now: float, *, marked: bool = False
    ) -> list[Cut]:
        """What was heard up to `now`; the last of it is what the port marked."""
        if not events:
            return []
        behind = self._decoder.held + sum(len(event.raw) for event in events)
        ends = []
        for event in events:
            behind -= len(event.raw)
            ends.append(now - behind * self._character)
        cuts = self._release(ends[0]) if self._asked else []
        for event, end in zip(events, ends, strict=True):
            wrong = marked and event is events[-1]
            cuts.append(self._after_others(Cut(event, self._heard, end, wrong)))
        return cuts

    def _after_others(self, cut: Cut) -> Cut:
        """Times never go back: bytes come in bursts, and faster on a simulated line."""
        self._end = max(self._end, cut.end)
        return cut._replace(end=self._end)


class WallClock:
    """The ns since 1970 of a monotonic time. Small steps of the clock change nothing.

    After a big one, or when the machine slept, it is looked at anew.
    """

    def __init__(self) -> None:
        self._offset: int | None = None

    def __call__(self, now: float) -> int:
        offset = time.time_ns() - time.monotonic_ns()
        if self._offset is None or abs(offset - self._offset) > MOST_DRIFT_NS:
            self._offset = offset
        return int(now * 1e9) + self._offset
