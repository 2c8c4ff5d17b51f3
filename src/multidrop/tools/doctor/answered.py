"""A doctor's reads, sorted: echo, answers, other masters' requests, and what is damaged."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from multidrop.tools.doctor.evidence import GLITCH, Arrived, Asked, Broken, Evidence, examine

MOST_PROOF = 4
"""Lines of proof for a verdict."""
FIXED = "tcp://"
"""Ports whose baud rate and format are set on the other side."""
WIRING = "check A and B (swapping them harms nothing), the common ground, and the devices' power"
TERMINATION = (
    "terminate both ends of the cable with 120 ohms, and nowhere else; one bias for the whole line"
)


def advice_on_settings(port: str) -> str:
    """How to try the others."""
    if port.startswith(FIXED):
        return (
            f"set other baud rates and formats in the device server, and try multidrop scan {port}"
        )
    return f"try the other settings: multidrop scan {port} --all-settings"


class Answered(NamedTuple):
    """One read and what came of it, sorted."""

    asked: Asked
    echo: Arrived | None
    answers: tuple[Arrived, ...]
    foreign: tuple[Arrived, ...]  # requests of another master
    strays: tuple[Arrived, ...]  # answers to something else
    broken: tuple[Broken, ...]
    size: int
    marked: int

    @property
    def damaged(self) -> bool:
        """More than a glitch came that is no frame."""
        return sum(len(item.raw) for item in self.broken) > GLITCH

    @property
    def ms(self) -> float:
        """From the end of the request to the first byte of its first answer."""
        left = self.asked.end if self.echo is None else max(self.asked.end, self.echo.end)
        return max(0.0, self.answers[0].start - left) * 1000


@dataclass(slots=True)
class Device:
    """An address and all reads of it in the thorough pass."""

    address: int
    reads: list[Answered] = field(default_factory=list)

    @property
    def right(self) -> list[Answered]:
        return [read for read in self.reads if read.answers]

    @property
    def damaged(self) -> list[Answered]:
        return [read for read in self.reads if read.damaged]

    @property
    def silent(self) -> list[Answered]:
        return [read for read in self.reads if not read.answers and not read.damaged]


def sort_out(asked: Asked, evidence: Evidence) -> Answered:
    """Echo, answers, another master's requests, and what is damaged."""
    protocol = evidence.protocol
    found = examine(asked.pieces, protocol, evidence.settings)
    echo: Arrived | None = None
    answers: list[Arrived] = []
    foreign: list[Arrived] = []
    strays: list[Arrived] = []
    for item in found.frames:
        if echo is None and item.frame == asked.frame:
            echo = item
        elif item.frame.answers(asked.frame):
            answers.append(item)
        else:
            (foreign if protocol.from_master(item.frame) else strays).append(item)
    sorts = tuple(answers), tuple(foreign), tuple(strays), tuple(found.broken)
    return Answered(asked, echo, *sorts, found.size, found.marked)


@dataclass(frozen=True, slots=True)
class Context:
    """What was asked at one setting, and what came of it."""

    evidence: Evidence
    reads: list[Answered]
    devices: list[Device]  # of the thorough pass

    def shown(self, item: Arrived | Broken, to: Asked | None = None) -> str:
        """Bytes, what they mean or why they do not, and when they came."""
        protocol = self.evidence.protocol
        text = protocol.shown(item.raw[:32]) + (" ..." if len(item.raw) > 32 else "")
        said = item.reason if isinstance(item, Broken) else protocol.describe(item.frame)
        when = "" if to is None else f"  (+{(item.start - to.end) * 1000:.1f} ms)"
        return f"< {text}  | {said}{when}"

    def asked(self, asked: Asked) -> str:
        protocol = self.evidence.protocol
        return f"> {protocol.shown(asked.raw)}  | {protocol.describe(asked.frame)}"

    def proof(self, reads: list[Answered]) -> tuple[str, ...]:
        """Each request with what came, as far as there is room."""
        lines = []
        for read in reads[: MOST_PROOF // 2]:
            lines.append(self.asked(read.asked))
            items: list[Arrived | Broken] = [*read.answers, *read.strays, *read.broken]
            items.sort(key=lambda item: item.start)
            lines += [self.shown(item, read.asked) for item in items[:3]]
        return tuple(lines)
