"""Many choices out of bytes that Hypothesis draws in one go.

Each draw costs Hypothesis more than its value is worth: a case of the stream
properties took 1.9 ms drawn field by field, and takes 0.7 ms from one draw.
Failures still shrink: smaller bytes are the earlier options and the shorter
lengths, and behind the last byte everything is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import update_wrapper
from inspect import signature
from math import ceil
from typing import TypeVar

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

T = TypeVar("T")

PERIOD = 16
"""Bytes of its own that a long piece has: it repeats them."""

TOGETHER = 10
"""Cases of an example, where they are not too many bytes for Hypothesis to shrink."""

MOST_BYTES = 2560
LEAST_EXAMPLES = 20


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


def tried_with(size: int) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A property of `choices` made of `size` bytes each: as many cases as the profile says.

    Every example is some cases together, since what Hypothesis does for an example
    takes longer than most of them. Whatever else the property takes, pytest gives.
    """

    def decorate(prop: Callable[..., None]) -> Callable[..., None]:
        known = signature(prop)
        drawn = known.replace(
            parameters=[
                item.replace(name="raw") if name == "choices" else item
                for name, item in known.parameters.items()
            ]
        )

        def tried(*args: object, **named: object) -> None:
            others = drawn.bind(*args, **named).arguments
            raw = others.pop("raw")
            for at in range(0, len(raw), size):
                prop(choices=Choices(raw[at : at + size]), **others)

        update_wrapper(tried, prop)
        del tried.__wrapped__  # type: ignore[attr-defined]  # its signature is another one
        tried.__signature__ = drawn  # type: ignore[attr-defined]
        assert settings.default is not None
        together = min(TOGETHER, MOST_BYTES // size)
        examples = max(LEAST_EXAMPLES, ceil(settings.default.max_examples / together))
        many = st.binary(min_size=together * size, max_size=together * size)
        return settings(max_examples=examples)(given(raw=many)(tried))

    return decorate


def decoded(one: Callable[[Choices], T], size: int = 64) -> SearchStrategy[T]:
    """What `one` makes of the choices in `size` bytes."""
    return st.binary(min_size=size, max_size=size).map(lambda raw: one(Choices(raw)))
