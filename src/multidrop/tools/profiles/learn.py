"""Learning names: what moved while somebody changed one parameter at the keypad."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from multidrop.errors import Error, NoReply, PortError
from multidrop.io.connection import Connection
from multidrop.io.readings import in_order, readable
from multidrop.points import Point, PointDescription, Reading, Role
from multidrop.profile import Profile

LEARNED = "learned"
"""What a learned point has for its source."""


@dataclass(frozen=True, slots=True)
class Moved:
    """A point that held something else before."""

    point: Point
    before: Reading
    after: Reading


class Learning:
    """Reads all points of a device again and again. `moving` are those that move by themselves."""

    def __init__(self, connection: Connection) -> None:
        """Raises `UsageError` where the profile has no points."""
        self.connection = connection
        self.points: Sequence[Point] = readable(connection.device)
        self.moving: set[str] = set()
        self._held: dict[str, Reading] = {}

    def begin(self) -> None:
        """Read everything twice, to see what moves without anybody. Raises `NoReply`, `PortError`."""
        self._read()
        self.moving = {moved.point.text for moved in self._read()}

    def changed(self) -> list[Moved]:
        """What moved since the last time, without what moves by itself. Raises as `begin`."""
        return [moved for moved in self._read() if moved.point.text not in self.moving]

    def use(self, profile: Profile) -> None:
        """Go on with what was learned; the points are the same."""
        target = self.connection.target
        target.profile = profile
        self.connection.device = target.device()
        self.points = readable(self.connection.device)

    def _read(self) -> list[Moved]:
        moved = {}
        answered = False
        for point, found in in_order(self.connection, self.points):
            if isinstance(found, PortError) or (isinstance(found, NoReply) and not answered):
                raise found
            if isinstance(found, Error):
                continue  # it keeps what it held
            answered = True
            before = self._held.get(point.text)
            if before is not None and before.raw != found.raw:
                moved[point.text] = Moved(point, before, found)
            self._held[point.text] = found
        return list(moved.values())


def described(
    moved: Moved, name: str, unit: str | None, role: Role
) -> tuple[PointDescription, str | None]:
    """The point with its name, and the name of that in whose place it is; None for an array's element."""
    known = moved.point.description
    if known is None or known.elements is not None:
        return PointDescription(name, moved.point.text, role, unit=unit, source=LEARNED), None
    learned = replace(known, name=name, role=role, unit=unit, source=LEARNED, note="")
    return learned, known.name
