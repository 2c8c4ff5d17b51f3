"""What a discovery needs of a protocol: the places where a device may have points, and what is there.

Nothing in here changes a device: every step is a read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from multidrop.conversation import Conversation
from multidrop.points import Point, PointDescription, Sample
from multidrop.profile import Profile

DISCOVERED = "discovered"
"""What a discovered point has for its source."""


@dataclass(frozen=True, slots=True)
class Discovered:
    """A point that is there, and what it held; None where that could not be read."""

    description: PointDescription
    sample: Sample | None = None


class Sweep(Protocol):
    """The places of one device, looked at one by one in any order."""

    profile: Profile
    """What was known before; `begin` may find out more of the device."""

    @property
    def places(self) -> Sequence[int]: ...
    @property
    def what(self) -> str:
        """What the places are, in the plural: indices, parameters."""
        ...

    def where(self, place: int) -> str:
        """A place as people write it."""
        ...

    def covers(self, description: PointDescription) -> bool:
        """Whether a point of the profile is at one of the places, so that it is found or is not there."""
        ...

    def begin(self) -> Conversation[Any, None]:
        """Find out what has to be known before. Raises what `Ask` raises, and `ProtocolError`."""
        ...

    def look(self, place: int) -> Conversation[Any, list[Discovered]]:
        """The points at a place, none where nothing is. Raises what `Ask` raises.

        Raises `DeviceError` where the device's refusal says neither.
        """
        ...

    def heard(self, point: Point, sample: Sample) -> PointDescription:
        """A point that somebody else was heard to read or to write; what the profile says of it, if it does."""
        ...
