"""The latest of every point, and who wants to hear of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from typing import NamedTuple

from multidrop.io.poller import Polled, Quality
from multidrop.points import Point, Value

Key = tuple[str, str]
"""Device, point: the names of the plant."""

TEXTS = {quality: quality.value for quality in Quality}
"""Quicker than `quality.value`, which is worked out each time."""

CLOCK_EVERY = 10.0
"""s between two questions whether the clock is synchronised."""


class Update(NamedTuple):
    """What was just heard of a point. `polled` has its quality, time and newest good reading.

    `monotonic` (s) goes on where wall time steps; `synchronised` says whether wall
    time can be trusted, None where nobody knows.
    """

    device: str
    point: str
    polled: Polled
    monotonic: float
    synchronised: bool | None = None

    @property
    def key(self) -> Key:
        return self.device, self.point

    @property
    def quality(self) -> Quality:
        return self.polled.quality

    @property
    def good(self) -> bool:
        return self.polled.good

    @property
    def value(self) -> Value | None:
        """The newest good value, physical; it is old where the quality is not good."""
        return self.polled.value


class Values:
    """The latest `Update` of each point. Listeners are called in the loop and must return at once.

    Those of `forgetting` are told, with a last update without a value, of what is no longer polled.
    """

    def __init__(
        self, now: Callable[[], float], synchronised: Callable[[], bool | None] = lambda: None
    ) -> None:
        self.latest: dict[Key, Update] = {}
        self.listeners: list[Callable[[Update], None]] = []
        self.forgetting: list[Callable[[Update], None]] = []
        self._now = now
        self._ask_clock = synchronised
        self._synchronised: bool | None = None
        self._asked = float("-inf")

    def take(self, polled: Polled) -> None:
        """A poll says something, or the read-back of a write. Raises what a listener raises."""
        now = self._now()
        if now - self._asked >= CLOCK_EVERY:
            self._asked, self._synchronised = now, self._ask_clock()
        name = polled.point.name or polled.point.text
        device = polled.device
        before = self.latest.get((device, name))
        if before is not None and not polled.good:
            polled = _with_newest(polled, before.polled)
        update = Update(device, name, polled, now, self._synchronised)
        self.latest[device, name] = update
        for listener in self.listeners:
            listener(update)

    def get(self, device: str, point: str) -> Update | None:
        """None before anything was said of it."""
        return self.latest.get((device, point))

    def of(self, device: str) -> Iterator[Update]:
        """The latest of all points of a device."""
        return (update for update in self.latest.values() if update.device == device)

    def keep_only(self, points: Mapping[Key, Point]) -> None:
        """Forget what is no longer polled, and what was read of a point that is another by now."""
        now, time = self._now(), datetime.now(UTC)
        for key, update in list(self.latest.items()):
            polled = update.polled
            if points.get(key) == polled.point:
                continue
            del self.latest[key]
            ended = polled._replace(quality=Quality.STALE, time=time, reading=None, error=None)
            for listener in self.forgetting:
                listener(update._replace(polled=ended, monotonic=now))


def _with_newest(polled: Polled, before: Polled) -> Polled:
    """A poll that failed knows what polls have read, and not what a write has found since."""
    known, own = before.reading, polled.reading
    if known is None or before.point != polled.point:
        return polled
    return polled if own is not None and own.time >= known.time else polled._replace(reading=known)
