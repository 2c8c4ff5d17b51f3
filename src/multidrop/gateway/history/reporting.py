"""What of a polled point is worth recording: its changes, and now and then that it has not changed.

Pure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from multidrop.gateway.history.records import Kept, Sample
from multidrop.io.poller import Quality

NUMBERS = (int, float)


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
        self._held: Callable[[], Sample] | None = None

    def repeats(self, value: Kept, quality: Quality, monotonic: float) -> bool:
        """Whether this is what was reported last, and not long ago: then `hold` is enough."""
        before = self._reported
        return (
            before is not None
            and quality is before.quality
            and monotonic - before.monotonic < self.rule.longest
            and not _apart(before.value, value, self.rule.deadband)
        )

    def hold(self, sample: Callable[[], Sample]) -> None:
        """What repeats is made into a sample only if a change comes next."""
        self._held = sample

    def take(self, sample: Sample) -> tuple[Sample, ...]:
        """What is to be recorded now, in order: nothing, this one, or the one before and this one."""
        if self.repeats(sample.value, sample.quality, sample.monotonic):
            self.hold(lambda: sample)
            return ()
        return self.report(sample)

    def report(self, sample: Sample) -> tuple[Sample, ...]:
        """The same of one that does not repeat."""
        before = self._reported
        changed = before is None or self._differs(before, sample)
        held, self._held, self._reported = self._held, None, sample
        return (held(), sample) if changed and held is not None else (sample,)

    def _differs(self, before: Sample, sample: Sample) -> bool:
        return sample.quality is not before.quality or _apart(
            before.value, sample.value, self.rule.deadband
        )


def _apart(one: Kept, other: Kept, deadband: float) -> bool:
    """Whether two values differ, numbers by the dead band at least."""
    if one == other:
        return False
    if isinstance(one, NUMBERS) and isinstance(other, NUMBERS):
        return not abs(one - other) < deadband
    return True
