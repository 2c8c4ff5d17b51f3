"""What passes on a line, understood: a question with what belongs to it, and what it means.

An `Observer` makes these of frames; a protocol's `explain` gives the meaning.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any, NamedTuple

from multidrop.points import Point, Sample, shown_value

# Named tuples, not dataclasses: a day of a full line is three million of them.


class Kind(StrEnum):
    """What a transaction is for. A write is whatever the device may keep or act on."""

    READ = "read"
    WRITE = "write"
    STATUS = "status"
    OTHER = "other"


class Refusal(NamedTuple):
    """A device that does not do what it was asked. `code` is None where the protocol has none."""

    code: int | None
    text: str


class Meaning(NamedTuple):
    """What the frames of one transaction say.

    `text` is one line for persons. `values` are what was read, or what was
    asked to be written, whether or not it was taken. `fault` is the device's
    fault bit, None without an answer or in a protocol without such a bit.
    `complete` is False where more frames may belong to it: a question without
    its answer, a Datalink change before its Acknowledge. `unread` are the points
    that were to be read, where no value came.
    """

    kind: Kind
    text: str
    values: tuple[tuple[Point, Sample], ...] = ()
    refusal: Refusal | None = None
    fault: bool | None = None
    complete: bool = True
    unread: tuple[Point, ...] = ()


class Heard(NamedTuple):
    """A frame on the line with its bytes and its time, s of the observer's clock.

    `start` is worked out from `end` and the size. `sent` is True for what this
    side sent, False for what it received, None where it only listens.
    """

    frame: Any
    raw: bytes
    start: float
    end: float
    sent: bool | None


class Transaction(NamedTuple):
    """A question and the frames that belong to it; alone where nobody answered.

    `answer_ms` is from the end of the question to the first byte of its answer.
    `echo` is the copy of the question that a line with local echo delivers.
    """

    frames: tuple[Heard, ...]
    meaning: Meaning
    address: int
    answer_ms: float | None
    echo: Heard | None = None


class Stray(NamedTuple):
    """A frame that answers nothing that was asked: a late answer, or one to somebody unheard."""

    heard: Heard
    text: str


class Damage(NamedTuple):
    """Bytes that belong to no frame, why not, and when the last of them came."""

    raw: bytes
    reason: str
    at: float
    sent: bool | None = None


def shown(point: Point, sample: Sample) -> str:
    """A sample's physical value with its unit, and its name where the profile has one."""
    description = point.description
    if description is None or isinstance(sample.value, str | bytes):
        return shown_value(sample.value)
    text = shown_value(description.physical(sample.value))
    if description.unit:
        text += f" {description.unit}"
    if description.has_meanings:
        meaning = description.meaning_of(sample.value)
        text += f" ({meaning})" if meaning else ""
    return text


__all__ = [
    "Damage",
    "Heard",
    "Kind",
    "Meaning",
    "Refusal",
    "Stray",
    "Transaction",
    "shown",
]
