"""64 paced lines, each as full as it goes, in one `multidrop run` with everything on, on one core."""

from __future__ import annotations

import contextlib
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median

from bench.gateway_plants import PACED_KINDS, paced
from bench.gateway_process import (
    Subscriber,
    asked,
    broker,
    cores,
    gateway,
    mqtt_missing,
    simulated,
    wait_until,
)
from bench.latency import latencies, shown
from bench.measure import Result
from bench.service_lines import BAUD, KINDS, LINES, kind_of
from multidrop.io.connection import Target

SETTLE = 4.0  # s that do not count, once every line has answered
GOAL = 0.95


@dataclass(frozen=True, slots=True)
class Round:
    """`shares` of each line's limit; s of processor time a second; answers a second; ms to those who listen."""

    shares: list[float]
    core: float
    polls: float
    browser: list[float]
    mqtt: list[float]
    late: float  # ms, the simulator's own


def run(seconds: float) -> Round:
    own, simulator, rest = cores()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        lines, ports = stack.enter_context(
            simulated("many_simulated", simulator, LINES, 0, *PACED_KINDS)
        )
        mqtt = stack.enter_context(broker(folder, rest))
        process = stack.enter_context(gateway(paced(folder, ports, mqtt), own, full=True))
        wait_until(lambda: min(len(answers) for answers in asked(lines, "report")) > 0)
        browser, _ = stack.enter_context(simulated("browsers", rest, process.http, 1))
        states = None if mqtt is None else Subscriber(mqtt, folder, rest)
        time.sleep(SETTLE)
        asked(browser, "told")
        used, begin = process.used, time.monotonic()
        time.sleep(seconds)
        core, end = process.used - used, time.monotonic()
        noted = asked(lines, "report")
        within = [[one for one in line if begin <= one[2] < end] for line in noted]
        handed_over = [[out for _, _, out in line] for line in noted]
        return Round(
            [
                _busy(kind_of(number).profile, line) / (end - begin)
                for number, line in enumerate(within)
            ],
            core / (end - begin),
            sum(map(len, within)) / (end - begin),
            latencies(asked(browser, "told"), handed_over, begin, end - 1.0),
            latencies(states.end(), handed_over, begin, end - 1.0) if states else [],
            mean(out - due for line in within for _, due, out in line) * 1000,
        )


def _busy(profile: str, answers: list[list[float]]) -> float:
    """s that a line needs for these: the characters of question and answer, and the rest between."""
    gap = Target.of(f"{profile}:0@wire,baud={BAUD}").settings.gap
    return sum(due - came + gap for came, due, _ in answers)


def rows(quick: bool) -> list[Result]:
    series = [run(4.0 if quick else 15.0) for _ in range(1 if quick else 3)]
    slowest = {
        kind.profile: median(
            min(share for at, share in enumerate(found.shares) if kind_of(at) is kind)
            for found in series
        )
        for kind in KINDS
    }
    worst = min(slowest.values())
    told = [one for found in series for one in found.browser]
    states = [one for found in series for one in found.mqtt]
    polls = median(found.polls for found in series)
    each = median(found.core / found.polls for found in series) * 1e6
    return [
        Result(
            f"{LINES} paced {BAUD}-baud lines of three protocols, one gateway on one core, with history, page and MQTT",
            "each line's own limit",
            f">= {GOAL} of it, every line",
            f"{worst:.3f}",
            worst >= GOAL and not mqtt_missing(),
            [
                "the slowest of each: "
                + ", ".join(f"{profile} {share:.3f}" for profile, share in slowest.items()),
                f"{median(found.core for found in series):.0%} of the core, "
                f"{polls:.0f} polls a second, {each:.0f} µs a poll",
                f"the simulator hands over {median(found.late for found in series):.2f} ms late",
                f"from the wire to a browser {shown(told)}",
                f"from the wire to an MQTT subscriber {shown(states)}"
                if states
                else f"without MQTT: {mqtt_missing()}",
            ],
        )
    ]
