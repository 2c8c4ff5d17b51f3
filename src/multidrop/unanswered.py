"""Questions that were given up, in protocols whose messages have no numbers.

The answer to such a question may still come. It passes for the answer to any question
about the same: another element of an array, or a point that was written since.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Generic, TypeVar

from multidrop import conversation as steps

FrameT = TypeVar("FrameT", bound=steps.Frame)

MAY_COME = 1.5
"""s after it was given up, in which a question may still be answered."""


@dataclass(slots=True)
class _GivenUp(Generic[FrameT]):
    question: FrameT
    until: float
    as_good: bool  # whether a late answer to it is as good as one to the same question asked again


class Unanswered(Generic[FrameT]):
    """What may still be answered on one line."""

    def __init__(self) -> None:
        self.known: dict[Hashable, _GivenUp[FrameT]] = {}

    def give_up(self, question: FrameT, now: float, *, as_good: bool) -> None:
        """Nobody answered in time. `as_good`: it is a read, and nothing was done that it may show."""
        self.known[question.about] = _GivenUp(question, now + MAY_COME, as_good)

    def answered(self, answer: FrameT) -> None:
        """It may have been late: each attempt may bring one more, and that one shows an old value."""
        given_up = self.known.get(answer.about)
        if given_up is not None:
            given_up.as_good = False

    def acted(self, address: int | None) -> None:
        """A device was told to do something (None: all of them): what it was asked before is out of date."""
        for given_up in self.known.values():
            if address is None or given_up.question.address == address:
                given_up.as_good = False

    def clear_from(self, question: FrameT, now: float) -> float:
        """When it may be asked: at once where no late answer could be taken for its own.

        The same read as one that nobody answered may be asked again at once too,
        while a late answer to that is as good.
        """
        self.known = {about: known for about, known in self.known.items() if known.until > now}
        given_up = self.known.get(question.about)
        if given_up is None or (given_up.question == question and given_up.as_good):
            return now
        return given_up.until
