"""Many choices out of bytes that Hypothesis draws in one go.

Whatever it draws costs Hypothesis some 30 us of bookkeeping: a stream of six
frames, drawn field by field, takes longer than all that is then done with it.
Failures still shrink: smaller bytes are the earlier options and the shorter
lengths, and behind the last byte everything is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

T = TypeVar("T")

PERIOD = 16
"""Bytes of its own that a long piece has: it repeats them."""


class Choices:
    def __init__(self, raw: bytes) -> None:
        self._raw = raw
        self._at = 0

    def __repr__(self) -> str:
        return f"Choices(bytes.fromhex('{self._raw.rstrip(bytes(1)).hex(' ')}'))"

    def byte(self) -> int:
        at = self._at
        self._at = at + 1
        return self._raw[at] if at < len(self._raw) else 0

    def word(self) -> int:
        return self.byte() | self.byte() << 8

    def to(self, most: int) -> int:
        """0..most, which is at most 65535."""
        return (self.byte() if most <= 0xFF else self.word()) % (most + 1)

    def flag(self) -> bool:
        return self.byte() % 2 == 1

    def of(self, options: Sequence[T]) -> T:
        return options[self.to(len(options) - 1)]

    def data(self, most: int) -> bytes:
        """0..most bytes: mostly a few, sometimes many, often as many as may be."""
        kind = self.byte() % 8
        length = most if kind == 7 else self.to(most if kind > 4 else min(most, 12))
        own = min(length, PERIOD)
        at = self._at
        self._at = at + own
        piece = self._raw[at : at + own].ljust(own, b"\0")
        return (piece * (length // PERIOD + 1))[:length]

    def times(self, most: int, one: Callable[[Choices], T]) -> list[T]:
        """0..most of them."""
        return [one(self) for _ in range(self.to(most))]


def choices(size: int) -> SearchStrategy[Choices]:
    return st.binary(min_size=size, max_size=size).map(Choices)


def decoded(one: Callable[[Choices], T], size: int = 64) -> SearchStrategy[T]:
    """What `one` makes of the choices in `size` bytes."""
    return choices(size).map(one)
