"""What can go wrong on a line, on demand."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from multidrop.errors import UsageError
from multidrop.numerals import decimal_number
from multidrop.profile import nearest

LATE = 1.0
"""s by which a late answer comes later, unless set."""

GAP = 0.5
"""s of rest in the middle of an answer with a gap: longer than any master waits for the next byte
but Ultra3000's, whose documents know no limit."""

NOISE = bytes.fromhex("01 7F FF 00")
"""Bytes before a frame: SLINK3's START is among them, so they look like the beginning of one."""


class Fault(StrEnum):
    """What happens to one answer."""

    NO_ANSWER = "no-answer"
    LATE_ANSWER = "late-answer"
    WRONG_CHECKSUM = "wrong-checksum"
    CUT_SHORT = "cut-short"
    NOISE = "noise"
    OTHER_SLAVE = "other-slave"
    WRONG_SEQUENCE = "wrong-sequence"
    GAP = "gap"
    TWICE = "twice"


class Faults(Protocol):
    """Says for each answer what happens to it."""

    def draw(self) -> Fault | None: ...


class NoFaults:
    def draw(self) -> Fault | None:
        return None


@dataclass
class ScriptedFaults:
    """One fault after the other, then none."""

    faults: Iterator[Fault | None]

    def __init__(self, faults: Iterable[Fault | None]) -> None:
        self.faults = iter(faults)

    def draw(self) -> Fault | None:
        return next(self.faults, None)


class RandomFaults:
    """Each fault with its own probability, 0..1; the same seed gives the same line."""

    def __init__(self, rates: Mapping[Fault, float], seed: int | None = None) -> None:
        if sum(rates.values()) > 1:
            raise UsageError("the faults' rates add up to more than 100 %")
        self._rates = dict(rates)
        self._random = random.Random(seed)

    def draw(self) -> Fault | None:
        dice = self._random.random()
        for fault, rate in self._rates.items():
            if dice < rate:
                return fault
            dice -= rate
        return None


def parse_fault(text: str) -> tuple[Fault, float]:
    """`no-answer=5%` or `no-answer=0.05`. Raises `UsageError`."""
    name, equals, rate_text = text.partition("=")
    try:
        fault = Fault(name)
    except ValueError:
        names = [fault.value for fault in Fault]
        raise UsageError(
            f"there is no fault {name!r}{nearest(name, names)}; faults are {' '.join(names)}"
        ) from None
    try:
        rate = decimal_number(rate_text.rstrip("%")) / (100 if rate_text.endswith("%") else 1)
    except ValueError:
        rate = -1.0
    if not equals or not 0 <= rate <= 1:
        raise UsageError(f"{text!r} is not of the form {name}=5% (0..100 %)")
    return fault, rate
