"""Which points a vendor's tool asks for, from a capture that was made while it ran."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.io.captured import CaptureReader
from multidrop.naming import DeviceName
from multidrop.observer import Found
from multidrop.points import Point, PointDescription, Sample, Value, shown_value
from multidrop.profile import Profile
from multidrop.protocols import PROTOCOLS
from multidrop.sweeping import Sweep
from multidrop.tools.captures.decode import Decoding
from multidrop.tools.captures.following import Follower
from multidrop.tools.profiles.discover import named
from multidrop.transaction import Kind, Transaction

MOST_TEXTS = 3
"""Values that are no numbers, of which so many are kept."""


@dataclass(slots=True)
class HeardPoint:
    """A point that was heard: how often, from when to when (s), and which values it had."""

    description: PointDescription
    type: str
    reads: int = 0
    writes: int = 0
    first: float = 0.0
    last: float = 0.0
    values: list[Value] = field(default_factory=list)  # least and greatest, or some texts

    @property
    def every(self) -> float | None:
        """s between two reads, on average; None of a single one."""
        return (self.last - self.first) / (self.reads - 1) if self.reads > 1 else None

    def add(self, value: Value, kind: Kind, at: float) -> None:
        if kind is Kind.WRITE:
            self.writes += 1
        else:
            self.first = at if not self.reads else self.first
            self.last = at
            self.reads += 1
        if not isinstance(value, str | bytes):
            known = [item for item in self.values if not isinstance(item, str | bytes)]
            self.values = [min([*known, value]), max([*known, value])]
        elif value not in self.values and len(self.values) < MOST_TEXTS:
            self.values.append(value)

    @property
    def said(self) -> str:
        """What was heard, in a few words."""
        parts = []
        if self.reads:
            every = f", every {self.every:.3g} s" if self.every is not None else ""
            parts.append(f"read {_times(self.reads)}{every}")
        if self.writes:
            parts.append(f"written {_times(self.writes)}")
        texts = list(dict.fromkeys(shown_value(value) for value in self.values))
        between = ", " if any(isinstance(value, str | bytes) for value in self.values) else ".."
        parts.append(f"value{'s' * (len(texts) > 1)} {between.join(texts)}")
        return "; ".join(parts)


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count:,} times"


@dataclass(frozen=True, slots=True)
class Heard:
    """What was heard of one device."""

    base: Profile
    points: list[HeardPoint]
    notes: list[str]  # what the user should know of the capture

    def profile(self, name: str, source: str) -> Profile:
        """The points that were heard, and all that was known before."""
        known = self.base.points
        new = [
            replace(
                item.description, note="; ".join(filter(None, (item.said, item.description.note)))
            )
            for item in self.points
            if item.description.name not in known
        ]
        return replace(
            self.base,
            name=name,
            title=f"{self.base.title or self.base.name}, as it was heard",
            notes=f"heard in {source}",
            version="",
            points=named([*known.values(), *new]),
        )


def heard(path: str, device: DeviceName, base: Profile) -> Heard:
    """The points of a device that others read and wrote. `device.port` "" is any line of the capture.

    Raises `UsageError` where the capture has nothing of it, with whom it has.
    """
    assert device.address is not None
    protocol = PROTOCOLS[base.protocol]
    sweep = protocol.sweep(device.address, base, {}, None)
    points: dict[str, HeardPoint] = {}
    others: set[int] = set()
    notes: list[str] = []
    for found, at in _transactions(path, device, base, protocol, notes):
        others.add(found.address)
        if found.address != device.address or found.meaning.refusal is not None:
            continue
        for point, sample in found.meaning.values:
            _add(points, sweep, point, sample, found.meaning.kind, at)
    if not points:
        there = ", ".join(map(str, sorted(others))) or "none"
        raise UsageError(
            f"{path} has no values of {base.protocol} address {device.address}; addresses are: {there}"
        )
    return Heard(base, list(points.values()), notes)


def _add(
    points: dict[str, HeardPoint], sweep: Sweep, point: Point, sample: Sample, kind: Kind, at: float
) -> None:
    description = sweep.heard(point, sample)
    known = points.get(description.at)
    if known is None:
        known = points[description.at] = HeardPoint(description, sample.type)
    elif (description.elements or 0) > (known.description.elements or 0):
        known.description = description
    known.add(point.physical(sample.value), kind, at)


def _transactions(
    path: str, device: DeviceName, base: Profile, protocol: ProtocolModule, notes: list[str]
) -> Iterator[tuple[Transaction, float]]:
    """Of the lines of this protocol, with their times in s."""
    assert device.address is not None
    reader = CaptureReader(path)
    decoding = Decoding(protocol=protocol.name, profiles={device.address: base})
    followers: dict[int, Follower | None] = {}
    for packet in reader.packets():
        if packet.interface not in followers:
            interface = reader.interfaces[packet.interface]
            spoken = interface.protocol.name if interface.protocol else protocol.name
            wanted = spoken == protocol.name and device.port in ("", interface.name)
            followers[packet.interface] = decoding.follower(interface, notes) if wanted else None
        follower = followers[packet.interface]
        if follower is not None:
            yield from _of(follower.packet(packet, packet.time_ns / 1e9))
    for follower in followers.values():
        if follower is not None:
            yield from _of(follower.finish())
    if reader.ending:
        notes.append(reader.ending)


def _of(found: list[Found]) -> Iterator[tuple[Transaction, float]]:
    for item in found:
        if isinstance(item, Transaction):
            yield item, item.frames[-1].end
