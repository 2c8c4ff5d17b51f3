"""What is read and written, and what comes of it: points, samples, readings."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple

from multidrop.description import PointDescription, Role, Value, shown_value


@dataclass(frozen=True, slots=True)
class Point:
    """One thing to read or write, as its protocol's grammar says it.

    `text` is the grammar without the type; `type` the type's name, None where
    it is not known yet; `description` what the profile says of it. A protocol
    adds its own fields in a subclass.
    """

    text: str
    type: str | None = None
    description: PointDescription | None = None

    @property
    def name(self) -> str | None:
        return self.description.name if self.description else None

    @property
    def role(self) -> Role:
        return self.description.role if self.description else Role.UNKNOWN

    @property
    def unit(self) -> str | None:
        return self.description.unit if self.description else None

    @property
    def within(self) -> str:
        """Who in the device answers, where it is not the device itself: that one's is the fault bit."""
        return ""

    def raw_text(self, raw: bytes) -> str:
        """A sample's bytes as people and programs are shown them: hex, unless the protocol is text."""
        return raw.hex()

    def physical(self, raw: Value) -> Value:
        """The physical value of a raw one, by the profile's scale."""
        return self.description.physical(raw) if self.description else raw

    def reading(self, sample: Sample, time: datetime, ms: float) -> Reading:
        """What a device gave for this point, with all that is known of it."""
        value, type_, raw, fault = sample
        known, raw_text = self.description, self.raw_text(raw)
        if known is None:
            return Reading(self.text, None, value, None, type_, raw, fault, time, ms, raw_text)
        return Reading(
            self.text,
            known.name,
            known.physical(value),
            known.unit,
            type_,
            raw,
            fault,
            time,
            ms,
            raw_text,
            known.meaning_of(value),
        )

    def __str__(self) -> str:
        return f"{self.name} ({self.text})" if self.name else self.text


# Named tuples, not dataclasses: a gateway makes thousands of each every second.


class Sample(NamedTuple):
    """What a device gave for a point: unscaled `value`, its bytes on the wire, its fault bit.

    `fault` is None where the protocol has no such bit.
    """

    value: Value
    type: str
    raw: bytes
    fault: bool | None = None


class Reading(NamedTuple):
    """A physical value with everything that is known of it.

    `time` (UTC) is the receipt of the answer's last byte, `ms` the time from
    the start of the request to that byte, in milliseconds.
    """

    point: str
    name: str | None
    value: Value
    unit: str | None
    type: str
    raw: bytes
    fault: bool | None
    time: datetime
    ms: float
    raw_text: str = ""  # `raw` as it is shown: hex, or the characters of a text protocol
    meaning: str | None = None  # the name of the value, or of its bits, where the profile has one


__all__ = ["Point", "PointDescription", "Reading", "Role", "Sample", "Value", "shown_value"]
