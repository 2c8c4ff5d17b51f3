"""What everything above the protocols needs of a protocol and of a device that speaks it.

A protocol package fills these in; line, command line, simulator and gateway use
nothing else, so none of them knows a protocol by name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

from multidrop.conversation import Conversation
from multidrop.decoder import Decoder
from multidrop.points import Point, Sample, Value
from multidrop.profile import Profile
from multidrop.timing import LineSettings
from multidrop.writing import Written


@dataclass(frozen=True, slots=True)
class Report:
    """What a service found: `fields` for programs, `lines` for people."""

    fields: dict[str, Any] = field(default_factory=dict)
    lines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Write:
    """A write that was parsed, resolved and range-checked, and not sent yet."""

    point: Point
    value: Value | str
    force: bool = False


class OneByOne(ABC):
    """For protocols whose every message reads one point: no ranges, groups of one."""

    @abstractmethod
    def point(self, text: str) -> Point: ...

    @abstractmethod
    def read(self, point: Point) -> Conversation[Any, Sample]: ...

    def points(self, text: str) -> Sequence[Point]:
        return [self.point(text)]

    def plan(self, points: Iterable[Point]) -> Sequence[tuple[Point, ...]]:
        return [(point,) for point in points]

    def read_group(self, group: Sequence[Point]) -> Conversation[Any, list[Sample]]:
        samples = []
        for point in group:
            samples.append((yield from self.read(point)))
        return samples


class Device(Protocol):
    """One addressed device: every method describes a conversation, or refuses before one byte."""

    profile: Profile
    address: int

    def point(self, text: str) -> Point:
        """The point that `text` names. Raises `UsageError` with the grammar or the nearest name."""
        ...

    def points(self, text: str) -> Sequence[Point]:
        """The points that `text` names: several where the grammar has ranges."""
        ...

    def plan(self, points: Iterable[Point]) -> Sequence[tuple[Point, ...]]:
        """The points in groups; `read_group` reads each with one message where the protocol can."""
        ...

    def read_group(self, group: Sequence[Point]) -> Conversation[Any, list[Sample]]: ...

    def prepare_write(self, text: str, value: Value | str, *, force: bool = False) -> Write:
        """Check everything that can be checked before a byte is sent. Raises `UsageError`."""
        ...

    def read(self, point: Point) -> Conversation[Any, Sample]: ...
    def write(self, write: Write, *, verify: bool = True) -> Conversation[Any, Written]: ...
    def status(self) -> Conversation[Any, Report]: ...
    def clear_faults(self) -> Conversation[Any, Report]: ...
    def reset_comm(self) -> Conversation[Any, Report]: ...
    def prepare_raw(self, text: str) -> Callable[[], Conversation[Any, Report]]:
        """One command body as is; raises `UsageError` before anything is sent."""
        ...


@dataclass(frozen=True, slots=True)
class Received:
    """What one slave of a broadcast is known to have done."""

    address: int
    received: bool | None  # None where the dialect cannot be asked
    applied: bool | None
    note: str = ""
    written: tuple[Written, ...] = ()


class ProtocolModule(Protocol):
    """A protocol, as `PROTOCOLS` holds it."""

    name: ClassVar[str]
    line: LineSettings
    options: Mapping[str, str]
    """Keys of its own behind a device's name, and what they mean."""

    def decoder(self) -> Decoder[Any]: ...
    def device(self, address: int, profile: Profile, options: Mapping[str, str]) -> Device: ...
    def describe(self, frame: Any) -> str:
        """A decoded frame in one line, for traces."""
        ...

    def from_master(self, frame: Any) -> bool: ...
    def prepare_broadcast(
        self,
        profile: Profile,
        points: Iterable[tuple[str, str]],
        addresses: Iterable[int],
        options: Mapping[str, str],
        *,
        force: bool = False,
        keep_going: bool = False,
    ) -> Callable[[], Conversation[Any, list[Received]]]:
        """Write points of every slave at once, then ask each of `addresses`.

        Raises `UsageError` at once where something cannot be broadcast.
        """
        ...
