"""What of a polled point is worth recording: its changes, and now and then that it has not changed.

Pure.
"""

from __future__ import annotations

from dataclasses import dataclass

from multidrop.gateway.records import Kept, Sample


@dataclass(frozen=True, slots=True)
class Rule:
    """`deadband` (physical): a smaller change is none. `longest` (s): recorded again after it."""

    deadband: float = 0.0
    longest: float = 600.0


class Reporting:
    """One point: which of its samples are recorded.

    With a change comes the sample right before it too, so that history shows how long the
    old value held, and not a slope. Every change of quality is recorded.
    """

    def __init__(self, rule: Rule) -> None:
        self.rule = rule
        self._reported: Sample | None = None
        self._held: Sample | None = None

    def take(self, sample: Sample) -> tuple[Sample, ...]:
        """What is to be recorded now, in order: nothing, this one, or the one before and this one."""
        before = self._reported
        changed = before is None or self._differs(before, sample)
        if before is not None and not changed and self._young(before, sample):
            self._held = sample
            return ()
        held, self._held, self._reported = self._held, None, sample
        return (held, sample) if changed and held is not None else (sample,)

    def _young(self, before: Sample, sample: Sample) -> bool:
        return sample.monotonic - before.monotonic < self.rule.longest

    def _differs(self, before: Sample, sample: Sample) -> bool:
        return sample.quality is not before.quality or _apart(
            before.value, sample.value, self.rule.deadband
        )


def _apart(one: Kept, other: Kept, deadband: float) -> bool:
    """Whether two values differ, numbers by the dead band at least."""
    if isinstance(one, int | float) and isinstance(other, int | float):
        return one != other and not abs(one - other) < deadband
    return one != other
