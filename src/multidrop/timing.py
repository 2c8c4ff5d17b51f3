"""Character times, gaps and limits: the arithmetic of a serial line. Seconds throughout."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from multidrop.decoder import Decoder
from multidrop.errors import UsageError

SLOW = 9600
"""Baud rates below this one have characters of more than a millisecond or so: 100 ms at 110 baud."""


@dataclass(frozen=True, slots=True)
class Format:
    """Data bits, parity and stop bits of a character, written `8E1`, `7O1`, `8N1`."""

    data_bits: int = 8
    parity: str = "E"  # N, E, O
    stop_bits: int = 1

    @classmethod
    def parse(cls, text: str) -> Format:
        found = re.fullmatch(r"([78])([NEO])([12])", text.strip().upper())
        if found is None:
            raise UsageError(
                f"format {text!r} is not of the form 8E1: 7 or 8 data bits, parity N, E or O, 1 or 2 stop bits"
            )
        return cls(int(found[1]), found[2], int(found[3]))

    def __str__(self) -> str:
        return f"{self.data_bits}{self.parity}{self.stop_bits}"

    @property
    def bits(self) -> int:
        """Bits of one character on the wire, start bit included."""
        return 1 + self.data_bits + (self.parity != "N") + self.stop_bits


@dataclass(frozen=True, slots=True)
class LineSettings:
    """What a protocol's documents say of its line, and what a user may set instead.

    The defaults of the slack fields are for adapters and networks that deliver
    bytes later than the wire did: USB adapters in bursts up to 16 ms apart, TCP
    after a pause for a lost segment.
    """

    baud: int
    format: Format
    gap: float  # least time from the last byte of an answer to the next request
    byte_gap: float  # longest time between two bytes of one frame on the wire
    answer: float  # longest time from the end of a request to the first byte of its answer
    longest_frame: int  # bytes
    decoder: Callable[[], Decoder[Any]] = field(repr=False)  # the protocol's receive loop
    answer_slack_serial: float = 0.020
    answer_slack_network: float = 0.300
    silence_slack_serial: float = 0.030
    silence_slack_network: float = 0.300
    byte_gap_baud: int = 0  # below it `byte_gap` grows with the time of a bit; 0: never
    timeout: float | None = None  # set by the user: waits exactly so long for the first byte
    silence: float | None = (
        None  # set by the user: cuts a frame after exactly so long without a byte
    )
    attempts: int = 3

    def __post_init__(self) -> None:
        if not 50 <= self.baud <= 4_000_000:
            raise UsageError(f"baud rate {self.baud} is out of range: 50..4000000")
        if self.attempts < 1:
            raise UsageError(f"attempts={self.attempts}: at least 1")
        for name in ("timeout", "silence"):
            value = getattr(self, name)
            if value is not None and not 0 < value <= 60:
                raise UsageError(f"{name}={value:g} s is out of range: more than 0, at most 60")

    @property
    def character(self) -> float:
        """Time of one character on the wire."""
        return self.format.bits / self.baud

    def timing(self, *, network: bool) -> Timing:
        """The times that a master keeps on a serial port, or behind a network."""
        answer_slack = self.answer_slack_network if network else self.answer_slack_serial
        silence_slack = self.silence_slack_network if network else self.silence_slack_serial
        return Timing(
            character=self.character,
            gap=self.gap,
            answer=self.timeout
            if self.timeout is not None
            else self.answer + answer_slack + self._slow_character(),
            silence=self.silence
            if self.silence is not None
            else self.character + self._byte_gap() + silence_slack,
            longest_frame=self.longest_frame,
            attempts=self.attempts,
        )

    def _byte_gap(self) -> float:
        return self.byte_gap * max(1.0, self.byte_gap_baud / self.baud)

    def _slow_character(self) -> float:
        """A byte is heard at its end; what that takes is in the slack of any but slow lines."""
        return self.character if self.baud < SLOW else 0.0

    def with_options(self, **options: object) -> LineSettings:
        """The same settings with those of `options` that are not None."""
        return replace(self, **{key: value for key, value in options.items() if value is not None})  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class Timing:
    """The times that an exchange keeps, in seconds."""

    character: float
    gap: float  # before a request, after the last byte heard
    answer: float  # from the calculated end of a request to the first byte of an answer
    silence: float  # without a byte, after which a frame is cut short
    longest_frame: int
    attempts: int
