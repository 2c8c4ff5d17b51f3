"""A cyclic poll plan: what is read how often, how full that makes a line, what is due now.

No clock and no line in here: a plan is arithmetic, and `Schedule` takes the time
as an argument, in seconds of any monotonic clock.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from heapq import heapify, heappop, heappush
from math import floor
from typing import NamedTuple

from multidrop.device import Device, Sizes
from multidrop.errors import UsageError
from multidrop.points import Point
from multidrop.timing import LineSettings

TYPICAL_DELAY = 0.010
"""s from a question to its answer that a device is assumed to take until it was measured."""

SPREAD = 0.618
"""Share of a period by which the polls of each further period begin later: never in step."""

SHORTEST, LONGEST = 0.001, 86400.0
"""s: the periods that a poll may have."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """Points of one device that shall be read every so many seconds. `name` is the device's."""

    name: str
    device: Device
    points: tuple[Point, ...]
    every: float

    def __post_init__(self) -> None:
        if not SHORTEST <= self.every <= LONGEST:
            raise UsageError(
                f"{self.name}: every {self.every:g} s is out of range: {SHORTEST:g}..{LONGEST:g} s"
            )


@dataclass(frozen=True, slots=True)
class Poll:
    """Points that are read together, every `every` s from `phase` s after the start on."""

    name: str
    group: tuple[Point, ...]
    every: float
    sizes: tuple[Sizes, ...]
    seconds: float  # that the line is busy with it
    phase: float = 0.0

    @property
    def load(self) -> float:
        """Its share of the line, 0..1 and more."""
        return self.seconds / self.every


class Plan:
    """All that is polled on one line. `delays` are the answer delays of devices, where measured."""

    def __init__(
        self,
        settings: LineSettings,
        wanted: Iterable[Wanted],
        delays: Mapping[str, float] | None = None,
    ) -> None:
        self.settings = settings
        self.wanted = tuple(wanted)
        self.delays = dict(delays or {})
        self.polls = _spread([self._poll(*group) for group in _groups(self.wanted)])

    @property
    def load(self) -> float:
        """The share of the line's time that these polls take, 0..1; over 1 they do not fit."""
        return sum(poll.load for poll in self.polls)

    def adding(self, wanted: Iterable[Wanted]) -> Plan:
        """The plan with these points too."""
        return Plan(self.settings, (*self.wanted, *wanted), self.delays)

    def learned(self, delays: Mapping[str, float]) -> Plan:
        """The plan reckoned with measured answer delays, s, by the device's name."""
        return Plan(self.settings, self.wanted, {**self.delays, **delays})

    def with_more(self, wanted: Sequence[Wanted]) -> str:
        """For a person, before it is done: `61 %; with these 20 points 94 %`."""
        count = sum(len(more.points) for more in wanted)
        points = "this point" if count == 1 else f"these {count} points"
        return f"{self}; with {points} {self.adding(wanted)}"

    def __str__(self) -> str:
        return f"{self.load:.0%}".replace("%", " %")

    def _poll(self, name: str, device: Device, group: tuple[Point, ...], every: float) -> Poll:
        sizes = tuple(device.sizes(group))
        delay = self.delays.get(name, TYPICAL_DELAY)
        return Poll(name, group, every, sizes, line_time(self.settings, sizes, delay))


def line_time(settings: LineSettings, sizes: Sequence[Sizes], delay: float) -> float:
    """s that a line is busy with these messages: questions, delays, answers, and the gaps behind."""
    return wire_time(settings, sizes) + len(sizes) * (delay + settings.gap)


def wire_time(settings: LineSettings, sizes: Iterable[Sizes]) -> float:
    """s of the characters alone."""
    return sum(size.question + size.answer for size in sizes) * settings.character


def _groups(
    wanted: Iterable[Wanted],
) -> Iterable[tuple[str, Device, tuple[Point, ...], float]]:
    """What one poll reads: points of a device with the same period, as its `plan` joins them.

    A point that is wanted twice is read with the shorter period.
    """
    shortest: dict[tuple[str, Point], float] = {}
    devices: dict[str, Device] = {}
    for want in wanted:
        devices[want.name] = want.device
        for point in want.points:
            key = want.name, point
            shortest[key] = min(want.every, shortest.get(key, want.every))
    together: dict[tuple[float, str], list[Point]] = {}
    for (name, point), every in shortest.items():
        together.setdefault((every, name), []).append(point)
    for (every, name), points in together.items():
        for group in devices[name].plan(points):
            yield name, devices[name], tuple(group), every


def _spread(polls: Sequence[Poll]) -> tuple[Poll, ...]:
    """Each with its phase: those of one period follow each other as evenly as their times allow."""
    found: list[Poll] = []
    for number, every in enumerate(sorted({poll.every for poll in polls})):
        same = _by_turns([poll for poll in polls if poll.every == every])
        total = sum(poll.seconds for poll in same)
        before = 0.0
        for poll in same:
            phase = (before / total + number * SPREAD) % 1.0 * every
            found.append(replace(poll, phase=phase))
            before += poll.seconds
    return tuple(found)


def _by_turns(polls: Sequence[Poll]) -> list[Poll]:
    """One of each device, then the next of each: a device is not asked twice in a row."""
    turns: dict[str, int] = {}
    order: list[tuple[int, int]] = []
    for at, poll in enumerate(polls):
        turn = turns[poll.name] = turns.get(poll.name, -1) + 1
        order.append((turn, at))
    return [polls[at] for _, at in sorted(order)]


class Due(NamedTuple):
    """A poll whose time has come: the period `number`, counted from 0, that began at `at`."""

    poll: Poll
    at: float
    number: int
    place: int  # of the poll in its plan


class Schedule:
    """What is due when, from `start` on.

    Every poll keeps its grid, start + phase + n periods, however late it is: no drift.
    A period is read once, or missed and not made up for. Among those that are due the
    one goes first that has been due longest, so that on a line that is too full all of
    them are late and none is forgotten.
    """

    def __init__(self, plan: Plan, start: float) -> None:
        self._plan = plan
        self._start = start
        self._heap = [(start + poll.phase, place, 0) for place, poll in enumerate(plan.polls)]
        heapify(self._heap)

    @property
    def deadline(self) -> float:
        """When the next one is due; infinity where nothing is, or all of them are under way."""
        return self._heap[0][0] if self._heap else float("inf")

    def take(self, now: float) -> Due | None:
        """The poll that has been due longest; None where none is. It is under way until `finish`."""
        if now < self.deadline:
            return None
        at, place, number = heappop(self._heap)
        return Due(self._plan.polls[place], at, number, place)

    def finish(self, due: Due, now: float) -> int:
        """It was carried out. Returns how many of its periods went by in the meantime."""
        every = due.poll.every
        number = due.number + max(1, floor((now - due.at) / every))
        heappush(self._heap, (self._start + due.poll.phase + number * every, due.place, number))
        return number - due.number - 1
