"""What a line was like: frames, transactions, damage, and each device's answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from multidrop.observer import Found
from multidrop.tools.captures.listened import Listened
from multidrop.transaction import Damage, Stray, Transaction


@dataclass(slots=True)
class DeviceTally:
    """One device. `times` counts its answer times, in tenths of a millisecond."""

    kinds: Counter[str] = field(default_factory=Counter)
    refused: int = 0
    no_reply: int = 0
    faults: int = 0
    times: Counter[int] = field(default_factory=Counter)

    @property
    def median_ms(self) -> float | None:
        """Of its answer times; None without one."""
        left = (sum(self.times.values()) + 1) // 2
        for tenths in sorted(self.times):
            left -= self.times[tenths]
            if left <= 0:
                return tenths / 10
        return None

    @property
    def longest_ms(self) -> float | None:
        return max(self.times) / 10 if self.times else None

    def add(self, other: DeviceTally) -> None:
        self.kinds += other.kinds
        self.refused += other.refused
        self.no_reply += other.no_reply
        self.faults += other.faults
        self.times += other.times


@dataclass(slots=True)
class Tally:
    """One line, or a part of its time."""

    frames: int = 0
    transactions: int = 0
    strays: int = 0
    damaged: int = 0  # runs of bytes
    damaged_bytes: int = 0
    echoes: int = 0
    devices: dict[str, DeviceTally] = field(default_factory=dict)

    def count(self, found: Found, line: Listened | None) -> None:
        """What was found on a line."""
        if isinstance(found, Damage):
            self.damaged += 1
            self.damaged_bytes += len(found.raw)
        elif isinstance(found, Stray):
            self.strays += 1
            self.frames += 1
        else:
            assert line is not None, "without a protocol there are no frames"
            self._transaction(found, line.label(found.address))

    def _transaction(self, found: Transaction, label: str) -> None:
        frames, meaning, _, answer_ms, echo = found
        self.frames += len(frames)
        self.transactions += 1
        if echo is not None:
            self.frames += 1
            self.echoes += 1
        device = self.devices.get(label)
        if device is None:
            device = self.devices[label] = DeviceTally()
        device.kinds[meaning.kind.value] += 1
        if meaning.refusal is not None:
            device.refused += 1
        if meaning.fault:
            device.faults += 1
        if answer_ms is not None:
            device.times[round(answer_ms * 10)] += 1
        elif len(frames) == 1 and not meaning.complete:
            device.no_reply += 1

    def add(self, other: Tally) -> None:
        """Count what another one has counted too."""
        for name in ("frames", "transactions", "strays", "damaged", "damaged_bytes", "echoes"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for label, device in other.devices.items():
            self.devices.setdefault(label, DeviceTally()).add(device)

    @property
    def no_reply(self) -> int:
        return sum(device.no_reply for device in self.devices.values())

    def lines(self, seconds: float) -> Iterable[str]:
        """The closing summary."""
        parts = [f"{self.frames:,} frames", f"{self.transactions:,} transactions"]
        parts.append(f"{self.no_reply:,} without an answer")
        parts.append(f"{self.damaged:,} damaged")
        if self.strays:
            parts.append(f"{self.strays:,} not asked for")
        if self.echoes:
            parts.append(f"{self.echoes:,} echoes")
        yield f"{seconds:.1f} s: {', '.join(parts)}"
        for label, device in sorted(self.devices.items()):
            kinds = ", ".join(f"{count:,} {kind}" for kind, count in sorted(device.kinds.items()))
            yield f"  {label:<20} {kinds}{_troubles(device)}"


def _troubles(device: DeviceTally) -> str:
    text = ""
    if device.median_ms is not None:
        text += f"; answers after {device.median_ms:.1f} ms, at most {device.longest_ms:.1f} ms"
    for count, what in (
        (device.no_reply, "without an answer"),
        (device.refused, "refused"),
        (device.faults, "with the fault bit"),
    ):
        if count:
            text += f"; {count:,} {what}"
    return text
