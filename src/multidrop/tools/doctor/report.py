"""A doctor's report: verdicts, and every byte behind them with its time, as a text to send in."""

from __future__ import annotations

import platform
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from multidrop.tools.doctor.doctor import Case
from multidrop.tools.doctor.evidence import Asked, Evidence, Piece
from multidrop.tools.doctor.verdicts import Verdict

HEAD = re.compile(rb"multidrop \S+ doctor, ").match


def lines_of(verdict: Verdict) -> Iterator[str]:
    """A verdict for a person: what it is, the proof, what to do."""
    sure = "" if verdict.sure.value == "certain" else f" ({verdict.sure.value})"
    yield f"{verdict.text}{sure}"
    yield from (f"    {line}" for line in verdict.proof)
    yield from (f"  - {line}" for line in verdict.advice)


def is_report(path: Path) -> bool:
    """Whether a file begins as a report does. Raises `OSError`."""
    with path.open("rb") as file:
        return HEAD(file.readline(100)) is not None


def report(case: Case, verdicts: Iterable[Verdict], version: str, written: str) -> str:
    """The whole report; `written` is when, as text."""
    first = case.visits[0]
    lines = [
        f"multidrop {version} doctor, {written}",
        f"port {first.port}, {platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "",
    ]
    for verdict in verdicts:
        lines += [f"[{verdict.what.value}]", *lines_of(verdict), ""]
    for visit in (*case.visits, *([case.elsewhere] if case.elsewhere else [])):
        lines += _visit(visit)
    return "\n".join(lines) + "\n"


def _visit(visit: Evidence) -> Iterator[str]:
    settings = visit.settings
    timing = settings.timing(network=visit.network)
    latency = "" if visit.latency_ms is None else f", latency timer {visit.latency_ms} ms"
    yield (
        f"== {visit.setting}; answer {timing.answer:g} s, silence {timing.silence:g} s, "
        f"{'network' if visit.network else 'serial port'}{latency}"
    )
    started = min(
        [*(piece.now for piece in visit.heard), *(asked.start for asked in visit.asked)],
        default=0.0,
    )
    yield f"listened for {visit.seconds:g} s"
    yield from (_piece(piece, started) for piece in visit.heard)
    for asked in visit.asked:
        yield from _asked(asked, started)
    yield ""


def _asked(asked: Asked, started: float) -> Iterator[str]:
    yield f"{asked.start - started:12.6f} > {_hex(asked.raw)}"
    yield from (_piece(piece, started) for piece in asked.pieces)


def _piece(piece: Piece, started: float) -> str:
    marked = "  ! parity or framing error" if piece.damaged else ""
    return f"{piece.now - started:12.6f} < {_hex(piece.data)}{marked}"


def _hex(data: bytes) -> str:
    return data.hex(" ").upper()
