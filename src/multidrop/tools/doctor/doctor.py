"""Why a line fails: from what was heard on it to verdicts, with the bytes that prove them. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from multidrop.tools.doctor.answered import FIXED, WIRING, advice_on_settings, sort_out
from multidrop.tools.doctor.evidence import GLITCH, Evidence, examine
from multidrop.tools.doctor.judging_answers import judge_answers
from multidrop.tools.doctor.judging_traffic import judge_traffic
from multidrop.tools.doctor.likely_settings import ALIKE, Candidate
from multidrop.tools.doctor.verdicts import Sure, Verdict, What

MOST_SHOWN = 48  # bytes of garbage


@dataclass(frozen=True, slots=True)
class Case:
    """All that is known. `visits` are in order, one a setting; what was heard last is the latest.

    `likely` is what garbage that was heard while listening may have been sent at, and
    `elsewhere` the visit to another setting at which it was understood.
    """

    visits: tuple[Evidence, ...]
    listen_only: bool = False
    likely: tuple[Candidate, ...] = ()
    elsewhere: Evidence | None = None


def judge(case: Case) -> list[Verdict]:
    """The verdicts, the most important one first; at least one."""
    telling = _telling(case.visits)
    verdicts = [*_garbage(case)]
    if not verdicts:
        for visit in case.visits:
            if visit.understood:
                verdicts += judge_traffic(visit, expected=case.listen_only)
                break
    verdicts += judge_answers(telling)
    trouble = [verdict for verdict in verdicts if verdict.status]
    notes = [verdict for verdict in verdicts if not verdict.status]
    if not trouble:
        trouble = [_fine(case, telling)]
    return [*trouble, *notes]


def _telling(visits: tuple[Evidence, ...]) -> Evidence:
    """The visit that says most: answers, else any bytes, else the last one."""

    def says(visit: Evidence) -> tuple[int, int]:
        reads = [sort_out(asked, visit) for asked in visit.asked]
        return sum(len(read.answers) for read in reads), sum(read.size for read in reads)

    return max(reversed(visits), key=says)


def _garbage(case: Case) -> Iterator[Verdict]:
    """Somebody speaks, and it is not understood at this setting."""
    visit = case.visits[0]
    data = b"".join(piece.data for piece in visit.heard)
    if len(data) <= GLITCH or any(each.understood for each in case.visits):
        return
    if case.elsewhere is not None:
        yield _understood_elsewhere(visit, data, case.elsewhere)
    elif case.likely and case.likely[0].likeness >= ALIKE:
        yield _alike(visit, data, case.likely[0])
    else:
        yield Verdict(
            What.SETTINGS,
            Sure.POSSIBLE,
            f"{_senseless(visit, data)}: another baud rate, another format, A and B swapped, or noise",
            (_shown(data), _pattern(data)),
            (advice_on_settings(visit.port), WIRING),
        )


def _understood_elsewhere(visit: Evidence, data: bytes, other: Evidence) -> Verdict:
    """The line was listened to again at another setting, and makes sense there."""
    here, there = _setting(visit), _setting(other)
    frames = examine(other.heard, other.protocol, other.settings).frames[:3]
    shown, describe = other.protocol.shown, other.protocol.describe
    return Verdict(
        What.SETTINGS,
        Sure.CERTAIN,
        f"the line is at {there} ({other.protocol.name}), and was listened to at {here}",
        (
            f"at {here}: {_shown(data)}",
            *(f"at {there}: {shown(item.raw)}  | {describe(item.frame)}" for item in frames),
        ),
        (f"use baud={other.settings.baud} and format={other.settings.format}",),
    )


def _alike(visit: Evidence, data: bytes, best: Candidate) -> Verdict:
    """What came is what a receiver here would make of a master at another setting, or of swapped wires."""
    baud, form = best.setting.baud, best.setting.format
    same = best.inverted and (baud, form) == (visit.settings.baud, visit.settings.format)
    fixed = visit.port.startswith(FIXED)
    advice = []
    if best.inverted:
        advice.append("swap A and B, which harms nothing")
    if not same:
        advice.append(
            f"set {'in the device server ' if fixed else ''}baud={baud} and format={form}"
        )
    if not fixed:
        advice.append(advice_on_settings(visit.port))
    return Verdict(
        What.SETTINGS,
        Sure.LIKELY,
        f"{_senseless(visit, data)}; they look like {'A and B swapped' if same else str(best)}",
        (_shown(data), f"likeness {best.likeness:.0%}", _pattern(data)),
        tuple(advice),
    )


def _senseless(visit: Evidence, data: bytes) -> str:
    found = examine(visit.heard, visit.protocol, visit.settings)
    marked = f", {found.marked} of them with framing or parity errors" if found.marked else ""
    return f"somebody speaks, and {len(data)} bytes{marked} make no sense at {_setting(visit)}"


def _setting(visit: Evidence) -> str:
    return f"{visit.settings.baud} {visit.settings.format}"


def _shown(data: bytes) -> str:
    return f"{data[:MOST_SHOWN].hex(' ').upper()}{' ...' if len(data) > MOST_SHOWN else ''}"


def _pattern(data: bytes) -> str:
    """What garbage looks like: long runs of equal bits, or none."""
    runs = sum(byte in _RUNS for byte in data)
    share = f"{runs} of {len(data)} bytes are runs of equal bits (00 80 C0 E0 F0 F8 FC FE FF)"
    if runs > 0.6 * len(data):
        return f"{share}: a slower sender than this receiver, or swapped wires"
    return f"{share}: no slower sender"


_RUNS = frozenset(bytes.fromhex("00 80 C0 E0 F0 F8 FC FE FF"))


def _fine(case: Case, telling: Evidence) -> Verdict:
    """No trouble was seen."""
    reads = [sort_out(asked, telling) for asked in telling.asked if asked.alone]
    right = [read for read in reads if read.answers]
    if right:
        devices = sorted({read.asked.frame.address for read in right})
        times = sorted(read.ms for read in right)
        echo = " The line hears itself, which is fine." if any(read.echo for read in reads) else ""
        return Verdict(
            What.HEALTHY,
            Sure.CERTAIN,
            f"the line is healthy: {len(right)} of {len(reads)} reads of {len(devices)} "
            f"device{'s' if len(devices) != 1 else ''} ({', '.join(map(str, devices))}) answered after "
            f"{times[len(times) // 2]:.1f} ms, at most {times[-1]:.1f} ms, at {telling.setting}.{echo}",
        )
    if any(visit.understood for visit in case.visits):
        return Verdict(What.HEALTHY, Sure.LIKELY, "no fault in what was heard")
    if telling.asked:
        return Verdict(
            What.SILENT,
            Sure.LIKELY,
            "frames came that answer nothing that was asked, or that came once and not again",
            (),
            ("look at every byte with --trace or --report",),
        )
    seconds = sum(visit.seconds for visit in case.visits)
    return Verdict(
        What.NO_BYTES,
        Sure.CERTAIN,
        f"not one frame was heard in {seconds:.0f} s",
        (),
        ("is a master running? Is the adapter connected to the pair that it sends on?", WIRING),
    )


__all__ = ["Case", "judge"]
