"""Discovery: which points a device has, found out with reads alone, as a profile.

::

    with multidrop.connect("flexmax:0@/dev/ttyUSB0") as drive:
        run = Discovery(drive, "8000..9999")
        print(run.estimate())       # s; looks at some of them, which counts
        for place in run.run():
            ...
        run.profile("press")
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import sqrt
from statistics import fmean, stdev
from typing import Any

from multidrop.conversation import Conversation
from multidrop.errors import DeviceError, Error, NoReply, PortError, ProtocolError
from multidrop.io.connection import Connection
from multidrop.points import PointDescription
from multidrop.profile import Profile
from multidrop.sweeping import Sweep

PROBES = 256
"""Places, spread over all, that are looked at first; the time for the others follows from them."""
FIRST_SHARE = 8
"""At most one place in so many is among the first of them."""
MOST_SHARE = 4
"""At most one place in so many is looked at before the time is said."""
SURE = 0.02
"""The standard error of the time, as a part of it, at which no more of them are needed."""
GOLDEN = 0.618034  # whose multiples fall nowhere twice
GONE = 3
"""So many places in a row without a reply: then one that answered is asked, to see who is silent."""

HOPELESS = 64
"""So many places that all went wrong, and nothing else came."""

Note = Callable[[int, list[PointDescription]], None]


@dataclass(frozen=True, slots=True)
class Summary:
    """What became of a discovery."""

    looked: int
    found: int
    known: int  # of those found, by the profile that was there before
    unanswered: tuple[str, ...]  # places of which nothing is known


class Discovery:
    """A discovery on its way. `found` are the points so far, by place."""

    def __init__(
        self,
        connection: Connection,
        where: str | None = None,
        *,
        found: dict[int, list[PointDescription]] | None = None,
        note: Note | None = None,
    ) -> None:
        """Of the places that `where` names; `found` from one before is left alone.

        `note` is called for each place that was looked at. Raises `UsageError`
        with the protocol's grammar of ranges.
        """
        target = connection.target
        assert target.name.address is not None
        self.connection = connection
        self.sweep: Sweep = target.protocol.sweep(
            target.name.address, target.profile, target.options.own, where
        )
        self.found = dict(found or {})
        self.failed: dict[int, Error] = {}
        self._note = note or (lambda place, points: None)
        self._begun = False
        self._silent = 0
        self._witness: int | None = None

    @property
    def left(self) -> list[int]:
        """Places that were not looked at."""
        return [place for place in self.sweep.places if place not in self.found]

    # -- looking ---------------------------------------------------------------------------

    def estimate(self) -> float:
        """s that the rest will take, worked out from some of it, which is looked at for that.

        Raises as `run`.
        """
        self._begin()
        left = self.left
        count = min(PROBES, -(-len(left) // FIRST_SHARE))
        most = len(left) // MOST_SHARE
        took: list[float] = []  # s for each place
        again = 0.0  # s for those that failed: they and their like are tried once more
        while probes := spread(left, count):
            for place in probes:
                took.append(self._timed(place))
                again += took[-1] if place in self.failed else 0.0
            left = sorted({*left} - {*probes})
            count = min(PROBES, most - len(took))
            if count <= 0 or _error(took, len(left)) <= SURE:
                break
        whole = again * (len(took) + len(left))
        return len(left) * fmean(took) + whole / len(took) if took else 0.0

    def _timed(self, place: int) -> float:
        now = self.connection.line.port.now
        started = now()
        self._look(place)
        return now() - started

    def run(self) -> Iterator[int]:
        """Look at all that is left; gives each place when it is known.

        Raises `PortError` when the port is lost, `NoReply` when the device has
        gone, and the first error where nothing else came.
        """
        self._begin()
        for again in (False, True):  # what a bad moment of the line hid is tried once more
            for place in self.left:
                if not again and place in self.failed:
                    continue
                self._look(place)
                yield place

    def _begin(self) -> None:
        if not self._begun:
            self._ask(self.sweep.begin())
            self._begun = True

    def _look(self, place: int) -> None:
        try:
            discovered = self._ask(self.sweep.look(place))
        except PortError:
            raise
        except (NoReply, ProtocolError, DeviceError) as error:
            self.failed[place] = error
            self._note_failure(error)
            return
        self._silent = 0
        self._witness = place
        points = [item.description for item in discovered]
        self.failed.pop(place, None)
        self.found[place] = points
        self._note(place, points)

    def _note_failure(self, error: Error) -> None:
        """Silence may be how a device says that nothing is there; one that says nothing has gone."""
        if not isinstance(error, NoReply):
            if self._witness is None and len(self.failed) == HOPELESS:
                raise error
            return
        self._silent += 1
        if self._witness is None:
            raise error
        if self._silent % GONE == 0:
            self._ask(self.sweep.look(self._witness))

    def _ask(self, conversation: Conversation[Any, Any]) -> Any:
        return self.connection.line.run(conversation)

    # -- the result ------------------------------------------------------------------------

    @property
    def points(self) -> Sequence[PointDescription]:
        """The points found, by their places."""
        return [point for place in sorted(self.found) for point in self.found[place]]

    def summary(self) -> Summary:
        known = self.sweep.profile.points
        points = self.points
        return Summary(
            looked=len(self.found),
            found=len(points),
            known=sum(point.name in known for point in points),
            unanswered=tuple(self.sweep.where(place) for place in sorted(self.failed)),
        )

    def profile(self, name: str) -> Profile:
        """What was found, and what was known before of other places."""
        before = self.sweep.profile
        elsewhere = [item for item in before.points.values() if not self.sweep.covers(item)]
        places = self.sweep.places
        first, last = self.sweep.where(places[0]), self.sweep.where(places[-1])
        return replace(
            before,
            name=name,
            title=f"{before.title or before.name}, as one was found",
            notes=f"{first} to {last} of {self.connection.name}, discovered {datetime.now(UTC):%Y-%m-%d}",
            version="",
            points=named([*elsewhere, *self.points]),
        )


def _error(took: Sequence[float], left: int) -> float:
    """The standard error of the time for `left` more places, as a part of it."""
    if len(took) < 2 or not left:
        return 0.0
    return stdev(took) * sqrt(1 / len(took) + 1 / left) / fmean(took)


def spread(places: Sequence[int], count: int) -> list[int]:
    """`count` of the places, one of each of as many stretches, not at equal distances."""
    step = len(places) / count if count else 0.0
    return [places[int((number + number * GOLDEN % 1) * step)] for number in range(count)]


def named(points: Sequence[PointDescription]) -> dict[str, PointDescription]:
    """Points by their names; of two of one name the second gets a number behind it."""
    found: dict[str, PointDescription] = {}
    for point in points:
        name, number = point.name, 1
        while name in found:
            number += 1
            name = f"{point.name}_{number}"
        found[name] = point if name == point.name else replace(point, name=name)
    return found


def discover(connection: Connection, where: str | None = None, *, name: str = "found") -> Profile:
    """The points of a device as a profile, at once. Raises as `Discovery` does."""
    run = Discovery(connection, where)
    for _ in run.run():
        pass
    return run.profile(name)
