"""What a doctor may say of a line: what it is, how sure that is, the proof, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from multidrop.errors import NoReply, ProtocolError

NO_REPLY, BROKEN = NoReply.exit_status, ProtocolError.exit_status


class What(StrEnum):
    """What is the matter. Those of the last lines are no trouble by themselves."""

    NO_BYTES = "no-bytes"
    ECHO_ONLY = "echo-only"
    SETTINGS = "wrong-settings"  # baud rate, format or polarity
    PARITY = "parity-errors"
    COLLISIONS = "collisions"
    SECOND_MASTER = "second-master"
    GAPS = "gaps"
    LATE = "late-answers"
    SAME_ADDRESS = "same-address"
    CHECKSUMS = "damaged-answers"
    SILENT = "lost-answers"
    ACKNOWLEDGE = "late-acknowledge"
    LATENCY = "adapter-latency"
    SOMEBODY = "another-master"
    HEALTHY = "healthy"


_STATUS = {
    What.NO_BYTES: NO_REPLY,
    What.ECHO_ONLY: NO_REPLY,
    What.LATE: NO_REPLY,
    What.SILENT: NO_REPLY,
    What.LATENCY: 0,
    What.SOMEBODY: 0,
    What.HEALTHY: 0,
}


class Sure(StrEnum):
    """How far the proof goes."""

    CERTAIN = "certain"
    LIKELY = "likely"
    POSSIBLE = "possible"


@dataclass(frozen=True, slots=True)
class Verdict:
    """One finding. `proof` are lines with bytes and times, `advice` what to do, in order."""

    what: What
    sure: Sure
    text: str
    proof: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()

    @property
    def status(self) -> int:
        """The exit status it stands for; 0 is no trouble."""
        return _STATUS.get(self.what, BROKEN)

    def fields(self) -> dict[str, Any]:
        """As an object of JSON."""
        return {
            "verdict": self.what.value,
            "sure": self.sure.value,
            "text": self.text,
            "proof": list(self.proof),
            "advice": list(self.advice),
        }


def status_of(verdicts: list[Verdict]) -> int:
    """Of the first that is trouble; 0 where none is."""
    return next((verdict.status for verdict in verdicts if verdict.status), 0)
