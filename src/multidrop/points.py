"""What is read and written, and what comes of it: points, samples, readings."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

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

    def __str__(self) -> str:
        return f"{self.name} ({self.text})" if self.name else self.text


@dataclass(frozen=True, slots=True)
class Sample:
    """What a device gave for a point: unscaled `value`, its bytes on the wire, its fault bit.

    `fault` is None where the protocol has no such bit.
    """

    value: Value
    type: str
    raw: bytes
    fault: bool | None = None


@dataclass(frozen=True, slots=True)
class Reading:
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
