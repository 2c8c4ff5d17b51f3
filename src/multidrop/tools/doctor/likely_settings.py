"""Which baud rate, format and polarity bytes that make no sense were probably sent at.

What a master of each protocol says first is sent at every setting that its devices may
have, and received at the one that was listened with; the setting whose bytes look most
like those that were heard is the likeliest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from math import sqrt
from typing import NamedTuple

from multidrop.protocols import PROTOCOLS
from multidrop.sim.misread import Setting, garbled

ADDRESSES = 8
"""So many of a protocol's addresses, from the first one on, are asked in the examples."""
ALIKE = 0.5
"""Likeness, 0..1, under which a setting should not be named."""


class Candidate(NamedTuple):
    """A setting, and how much what it would look like is like what was heard, 0..1."""

    setting: Setting
    protocol: str
    inverted: bool
    likeness: float

    def __str__(self) -> str:
        return f"{self.setting}{' with A and B swapped' if self.inverted else ''} ({self.protocol})"


def likely(data: bytes, heard: Setting) -> list[Candidate]:
    """The settings that `data`, received at `heard`, may have been sent at; the likeliest first."""
    found = _profile(data)
    candidates = [
        Candidate(sent, name, inverted, _likeness(found, _profile(example)))
        for name, sent, inverted, example in _examples(heard)
    ]
    return sorted(candidates, key=lambda item: (-item.likeness, item.inverted))


def _examples(heard: Setting) -> Iterator[tuple[str, Setting, bool, bytes]]:
    """What a receiver at `heard` would make of a master at each other setting."""
    for name, protocol in PROTOCOLS.items():
        prober = protocol.prober
        frames = [prober.probe(address).encode() for address in prober.addresses[:ADDRESSES]]
        for baud in prober.bauds:
            for form in prober.formats:
                sent = Setting(baud, form)
                for inverted in (False, True):
                    if sent != heard or inverted:
                        got = (garbled(raw, sent, heard, inverted=inverted) for raw in frames)
                        yield name, sent, inverted, b"".join(got)


def _profile(data: bytes) -> Counter[bytes]:
    """How often each byte, and each pair of neighbours, occurs."""
    singles = Counter(data[at : at + 1] for at in range(len(data)))
    return singles + Counter(data[at : at + 2] for at in range(len(data) - 1))


def _likeness(one: Counter[bytes], other: Counter[bytes]) -> float:
    """The cosine of the angle between them."""
    size = sqrt(sum(n * n for n in one.values()) * sum(n * n for n in other.values()))
    return sum(count * other[key] for key, count in one.items()) / size if size else 0.0


__all__ = ["Candidate", "likely"]
