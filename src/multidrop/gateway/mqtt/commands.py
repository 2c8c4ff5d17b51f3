"""What comes over MQTT to be written: which messages are commands, and what is answered to them. Pure.

A machine must not start because a broker came back: so a command says how long it counts, at
most ten seconds, and one that a broker has kept is none.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import isfinite
from typing import Any

from multidrop.errors import (
    DeviceError,
    Error,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    PortError,
    ProtocolError,
    UsageError,
)
from multidrop.gateway.values import Key
from multidrop.io.audit import jsonable, shown
from multidrop.writing import Outcome, Written

LONGEST_EXPIRY = 10
"""s that a command may count."""

LONGEST_PAYLOAD = 64
"""Bytes; no number that can be meant is longer."""

OUTCOMES: dict[type[Error], Outcome] = {
    UsageError: Outcome.NOT_SENT,
    DeviceError: Outcome.NOT_APPLIED,
    NoReply: Outcome.NOT_SENT,
    PortError: Outcome.NOT_SENT,
    ProtocolError: Outcome.UNKNOWN,
    OutcomeUnknown: Outcome.UNKNOWN,
    NotApplied: Outcome.NOT_APPLIED,
}
"""What went wrong -> what is known of the write."""


@dataclass(frozen=True, slots=True)
class Command:
    """A message to a command's topic. `expiry` (s) is None where it has none."""

    topic: str
    payload: bytes
    retained: bool
    expiry: int | None
    response: str | None = None
    correlation: bytes | None = None

    def refusal(self) -> str | None:
        """Why it is not carried out, whatever it says; None where it may be."""
        if self.retained:
            return "it is a retained message, which may be of any time"
        if self.expiry is None:
            return f"it has no message expiry, of at most {LONGEST_EXPIRY} s"
        if self.expiry > LONGEST_EXPIRY:
            return f"its message expiry is {self.expiry} s, and {LONGEST_EXPIRY} s is the most"
        return None

    @property
    def text(self) -> str:
        """The payload for a log."""
        return self.payload[:LONGEST_PAYLOAD].decode(errors="replace")

    def number(self) -> bool | int | float:
        """What is to be written. Raises `UsageError` for anything else than one JSON number or bool."""
        try:
            if len(self.payload) > LONGEST_PAYLOAD:
                raise ValueError
            value = json.loads(self.payload)
        except (ValueError, RecursionError):
            value = None
        if not isinstance(value, bool | int | float) or not isfinite(value):
            raise UsageError(f"{self.text!r} is not a number, true or false")
        return value


def may_answer(response: str, base: str, discovery: str | None) -> bool:
    """Whether somebody may have an answer there: not where states, commands or brokers' own topics are."""
    own = [base] if discovery is None else [base, discovery]
    inside = any(response == topic or response.startswith(f"{topic}/") for topic in own)
    wild = any(sign in response for sign in "+#\x00")
    return bool(response) and not inside and not wild and not response.startswith("$")


def done(key: Key | None, written: Written) -> str:
    """The answer to a command that was carried out."""
    description = written.point.description
    facts = {
        "old": shown(written.old, description),
        "asked": jsonable(written.asked),
        "found": shown(written.found, description),
        "outcome": written.outcome.value,
    }
    return _answer(key, facts)


def failed(key: Key | None, asked: Any, error: Error) -> str:
    """The answer to a command that was refused, or failed."""
    known = (outcome for which, outcome in OUTCOMES.items() if isinstance(error, which))
    outcome = next(known, Outcome.UNKNOWN)
    code = error.code if isinstance(error, DeviceError) else None
    facts = {
        "asked": asked,
        "outcome": outcome.value,
        "error": {"kind": error.kind, "code": code, "text": str(error)},
    }
    return _answer(key, facts)


def _answer(key: Key | None, facts: dict[str, Any]) -> str:
    device, point = key or (None, None)
    return json.dumps({"v": 1, "device": device, "point": point, **facts}, ensure_ascii=False)
