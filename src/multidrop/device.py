"""What everything above the protocols needs of a protocol and of a device that speaks it.

A protocol package fills these in; line, command line, simulator and gateway use
nothing else, so none of them knows a protocol by name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

from multidrop.conversation import Conversation
from multidrop.decoder import Decoder
from multidrop.errors import UsageError
from multidrop.points import Point, Sample, Value
from multidrop.profile import Profile
from multidrop.timing import LineSettings
from multidrop.writing import Written

if TYPE_CHECKING:
    from multidrop.probing import Prober
    from multidrop.relay import Relay
    from multidrop.sweeping import Sweep
    from multidrop.transaction import Meaning


@dataclass(frozen=True, slots=True)
class Report:
    """What a service found: `fields` for programs, `lines` for people.

    `refused` is whether the device's answer, shown as it came, is a refusal.
    """

    fields: dict[str, Any] = field(default_factory=dict)
    lines: tuple[str, ...] = ()
    refused: bool = False


@dataclass(frozen=True, slots=True)
class Write:
    """A write that was parsed, resolved and range-checked, and not sent yet."""

    point: Point
    value: Value | str
    force: bool = False


@dataclass(frozen=True, slots=True)
class Sizes:
    """Characters on the wire of a question and of its answer, as far as they are known before."""

    question: int
    answer: int


class OneByOne(ABC):
    """For protocols whose every message reads one point: no ranges, groups of one."""

    @abstractmethod
    def point(self, text: str) -> Point: ...

    @abstractmethod
    def read(self, point: Point) -> Conversation[Any, Sample]: ...

    @abstractmethod
    def size(self, point: Point) -> Sizes:
        """Of the message that reads a point."""

    def points(self, text: str) -> Sequence[Point]:
        return [self.point(text)]

    def plan(self, points: Iterable[Point]) -> Sequence[tuple[Point, ...]]:
        return [(point,) for point in points]

    def read_group(self, group: Sequence[Point]) -> Conversation[Any, list[Sample]]:
        samples = []
        for point in group:
            samples.append((yield from self.read(point)))
        return samples

    def sizes(self, group: Sequence[Point]) -> Sequence[Sizes]:
        return [self.size(point) for point in group]


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
    def sizes(self, group: Sequence[Point]) -> Sequence[Sizes]:
        """Of each message that `read_group` sends, once it knows the device."""
        ...

    def prepare_write(self, text: str, value: Value | str, *, force: bool = False) -> Write:
        """Check everything that can be checked before a byte is sent. Raises `UsageError`."""
        ...

    def read(self, point: Point) -> Conversation[Any, Sample]: ...
    def write(self, write: Write, *, verify: bool = True) -> Conversation[Any, Written]: ...
    def status(self) -> Conversation[Any, Report]: ...
    def running(self) -> Conversation[Any, str | None]:
        """What the device says it is doing that nobody should disturb, in words; None for nothing."""
        ...

    def clear_faults(self) -> Conversation[Any, Report]: ...
    def reset_comm(self) -> Conversation[Any, Report]: ...
    def prepare_raw(self, text: str) -> Callable[[], Conversation[Any, Report]]:
        """One command body as is; raises `UsageError` before anything is sent."""
        ...


def misleading(device: Device, names: Iterable[str]) -> Iterator[str]:
    """Names of points that the protocol's grammar takes for a place, which is another one than theirs.

    Whoever wrote to such a name would write there.
    """
    for name in names:
        with suppress(UsageError):  # what cannot be said at all is told elsewhere
            if any(point.name != name for point in device.points(name)):
                yield name


@runtime_checkable
class ReadsAll(Protocol):
    """A device whose profile can be read from end to end."""

    def readable(self) -> Sequence[Point]:
        """Every point of the profile that can be read, arrays element by element."""
        ...


@runtime_checkable
class Acts(Protocol):
    """A device that does things at once, on a word of the master: it homes, it resets."""

    @property
    def actions(self) -> Mapping[str, str]:
        """Name -> meaning."""
        ...

    def prepare_action(self, name: str) -> Callable[[], Conversation[Any, Report]]:
        """An action by name; raises `UsageError` before anything is sent."""
        ...


@dataclass(frozen=True, slots=True)
class Copy:
    """A copy between working and saved value that was checked, and not sent yet.

    `points` are what it changes: the point itself, or each element of an array.
    """

    point: Point
    save: bool  # from the working to the saved value, else back
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Memory:
    """What a device holds for a point; None where it has no such value."""

    point: Point
    working: Sample | None
    saved: Sample | None
    default: Sample | None

    @property
    def unsaved(self) -> bool:
        """Changed, and gone when the power is."""
        return _differ(self.working, self.saved)

    @property
    def customised(self) -> bool:
        """Saved, and not the default."""
        return _differ(self.saved, self.default)


def _differ(one: Sample | None, other: Sample | None) -> bool:
    return one is not None and other is not None and one.value != other.value


@runtime_checkable
class KeepsMemory(Protocol):
    """A device that keeps saved values and defaults beside those that it works with."""

    def prepare_copy(self, text: str, *, save: bool, force: bool = False) -> Copy:
        """Check the copy of a point, or of a whole array. Raises `UsageError`."""
        ...

    def copy(self, copy: Copy, *, verify: bool = True) -> Conversation[Any, list[Written]]:
        """Carry it out, once, and read back each of its points."""
        ...

    def comparable(self) -> Sequence[Point]:
        """Every point of the profile that has a saved value, arrays element by element."""
        ...

    def compare(self, point: Point) -> Conversation[Any, Memory]: ...


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
    link_type: ClassVar[int]
    """Of its packets in a capture: one of pcapng's numbers for private use, 147..162."""
    line: LineSettings
    options: Mapping[str, str]
    """Keys of its own behind a device's name, and what they mean."""
    prober: Prober
    """How a scan finds its devices."""

    def line_for(self, options: Mapping[str, str]) -> LineSettings:
        """The line's settings with these options of the protocol's own. Raises `UsageError`."""
        ...

    def decoder(self) -> Decoder[Any]: ...
    def device(self, address: int, profile: Profile, options: Mapping[str, str]) -> Device: ...
    def describe(self, frame: Any) -> str:
        """A decoded frame in one line, for traces."""
        ...

    def shown(self, raw: bytes) -> str:
        """Bytes of its lines for a person, whole frames or damage: hex, unless they are text."""
        ...

    def from_master(self, frame: Any) -> bool:
        """Whether a master sent it, as far as a frame shows by itself."""
        ...

    def continues(self, frames: Sequence[Any], frame: Any) -> bool:
        """Whether a frame belongs to the transaction of `frames` so far.

        It may be the answer to their question, or the acknowledge of their
        change. Of no frames: whether it may be the question of a new one.
        """
        ...

    def explain(self, frames: Sequence[Any], profile: Profile) -> Meaning:
        """What the frames of one transaction say, at least one; names and types by the profile.

        Nothing that a decoder yields makes it raise. Raises `UsageError` for a
        profile that says what the protocol cannot.
        """
        ...

    def sweep(
        self, address: int, profile: Profile, options: Mapping[str, str], text: str | None
    ) -> Sweep:
        """How a discovery finds the points of a device: where `text` says, else everywhere.

        Raises `UsageError` with the grammar of ranges.
        """
        ...

    def relay(self, options: Mapping[str, str]) -> Relay[Any]:
        """Its frames on a line that many masters share. Raises `UsageError`."""
        ...

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
