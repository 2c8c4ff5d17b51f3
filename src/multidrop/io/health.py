"""Which devices of a line are silent, when they are probed, and what happened on the line.

A device that does not answer costs one time-out. From then on it is not polled, but
probed: with one cheap read, asked once. Its first answer makes it a device like the
others again. No clock in here: the time is an argument, in seconds.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields

from multidrop.session import Counters

PROBES = 0.05
"""Share of a line's time that may go into probes that nobody answers, however many are silent."""

JUST_SILENT = 0.01
"""The part of it for devices that answered until just now: one lost answer costs such a device
no more than that poll, also on a line where others are dead."""


@dataclass(slots=True)
class DeviceCounters(Counters):
    """The same of one device, and more. `busy` is how long conversations with it held the line, s."""

    refusals: int = 0
    busy: float = 0.0
    delay: float | None = None  # s from a question to its answer, as it is now; None: never heard


def total(counters: list[Counters]) -> Counters:
    """All of them together."""
    names = [item.name for item in fields(Counters)]
    return Counters(*(sum(getattr(one, name) for one in counters) for name in names))


class _Allowance:
    """A share of the time. What was used of it is waited for afterwards."""

    def __init__(self, share: float) -> None:
        self._share = share
        self._before = float("-inf")
        self.free_at = float("-inf")

    def take(self, now: float, worst: float) -> None:
        """Begin something that takes at most `worst` s."""
        self._before = now
        self.free_at = now + worst / self._share

    def settle(self, seconds: float) -> None:
        """It took so long."""
        self.free_at = self._before + seconds / self._share


@dataclass(frozen=True, slots=True)
class Probe:
    """A device that may be probed now."""

    name: str
    just_silent: bool


class Health:
    """Who on a line is silent, and who of them may be probed."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}
        self._asked: dict[str, float] = {}  # of the silent: when they were asked last
        self._just_silent: deque[str] = deque()
        self._ring: deque[str] = deque()
        self._allowances = {
            True: _Allowance(JUST_SILENT),
            False: _Allowance(PROBES - JUST_SILENT),
        }

    def silent_since(self, name: str) -> float | None:
        """When a device began not to answer; None where it answers as far as is known."""
        return self._since.get(name)

    @property
    def silent(self) -> list[str]:
        """Those who are not polled now."""
        return list(self._since)

    def heard(self, name: str) -> bool:
        """A device answered, be it with a refusal. Returns whether it had been silent."""
        if self._since.pop(name, None) is None:
            return False
        for queue in (self._just_silent, self._ring):
            if name in queue:
                queue.remove(name)
        return True

    def not_heard(self, name: str, now: float) -> bool:
        """A device did not answer. Returns whether it had answered until now."""
        if name in self._since:
            return False
        self._since[name] = self._asked[name] = now
        self._just_silent.append(name)
        return True

    @property
    def deadline(self) -> float:
        """When the next probe may be sent; infinity where nobody is silent."""
        times = []
        if self._just_silent:
            times.append(self._allowances[True].free_at)
        if self._just_silent or self._ring:
            times.append(self._allowances[False].free_at)
        return min(times, default=float("inf"))

    def take(self, now: float, worst: float) -> Probe | None:
        """Whom to probe now, one after the other; None while no probe may be sent.

        A probe takes at most `worst` s. Its time is taken off the allowance until
        `probed` says how long it took.
        """
        if self._just_silent and self._allowances[True].free_at <= now:
            just_silent, name = True, self._just_silent.popleft()
        elif (self._ring or self._just_silent) and self._allowances[False].free_at <= now:
            just_silent, name = False, self._longest_not_asked().popleft()
        else:
            return None
        self._ring.append(name)
        self._asked[name] = now
        self._allowances[just_silent].take(now, worst)
        return Probe(name, just_silent)

    def _longest_not_asked(self) -> deque[str]:
        """The queue whose first one waits longest."""
        queues = [queue for queue in (self._just_silent, self._ring) if queue]
        return min(queues, key=lambda queue: self._asked[queue[0]])

    def probed(self, probe: Probe, seconds: float) -> None:
        """A probe took so long. One that was answered costs nothing: it was as good as a poll."""
        answered = probe.name not in self._since
        self._allowances[probe.just_silent].settle(0.0 if answered else seconds)


class Load:
    """How full a line was: the share of the last `window` s in which a conversation held it.

    What ended within one second is kept together, so that it needs little memory.
    """

    def __init__(self, window: float = 60.0) -> None:
        self.window = window
        self._seconds: deque[tuple[int, float]] = deque()  # which second, busy in it
        self._second, self._busy = -1, 0.0  # the one that is not over
        self._since: float | None = None

    def add(self, start: float, end: float) -> None:
        """A conversation held the line from `start` to `end`."""
        if int(end) != self._second:
            self._next_second(start, end)
        self._busy += end - start

    def _next_second(self, start: float, end: float) -> None:
        if self._since is None:
            self._since = start
        else:
            self._seconds.append((self._second, self._busy))
            self._forget(end)
        self._second, self._busy = int(end), 0.0

    def share(self, now: float) -> float:
        """0..1; of the time since the first conversation where that was later."""
        if self._since is None:
            return 0.0
        self._forget(now)
        span = min(self.window, now - self._since)
        busy = self._busy if self._second >= now - self.window else 0.0
        busy += sum(busy for _, busy in self._seconds)
        return min(1.0, busy / span) if span > 0 else 0.0

    def _forget(self, now: float) -> None:
        while self._seconds and self._seconds[0][0] < now - self.window:
            self._seconds.popleft()
