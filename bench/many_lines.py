"""Many paced lines in one process on one core, each against itself alone.

`python -m bench.many_lines CPU SECONDS` is that process: it reads the ports as a
line of JSON, polls some of the lines one at a time, then all of them together,
and prints the polls a second of each, and when each poll was asked and answered.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from array import array
from statistics import mean, median
from time import monotonic, process_time
from typing import Any, TypeAlias

from bench.measure import Result, line_of, start
from multidrop.io.async_line import AsyncLine, open_async_line
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Format, Master

CASES = ((200, 16.0), (200, 4.0), (200, 0.0), (100, 0.0))
"""Lines, and the ms between deliveries of an answer's bytes (0: each byte by itself)."""
ALONE = 6  # lines that are also polled alone
SETTLE = 0.5  # s that do not count
ON_THE_LINE = (11 + 13) * slink3.LINE.character  # s: request and answer
OWN_TIME = ON_THE_LINE + slink3.LINE.gap  # s: and the rest before the next request
LIMIT = 1 / OWN_TIME  # polls a second

Polls: TypeAlias = "array[float]"
"""Two of each poll: when it was asked, and when its answer was complete (monotonic, s)."""


async def polls(line: AsyncLine, seconds: float, seen: Polls, phase: float = 0.0) -> float:
    """Polls a second of a line that is read without a pause, once it has settled.

    Lines that start in step queue behind each other at first: each has its phase.
    """
    await asyncio.sleep(phase)
    master = Master(0)
    begin = monotonic() + SETTLE
    first = last = 0.0
    count = -1  # the first only starts the clock
    while last < begin + seconds:
        found = await line.timed(master.read_typed(8236, Format.SHORT_INT))
        seen.extend((found.received_at - found.seconds, found.received_at))
        last = monotonic()
        if last >= begin:
            first = first or last
            count += 1
    return count / (last - first)


async def measure(ports: list[str], seconds: float) -> dict[str, Any]:
    """Some lines alone, all together, some others alone."""
    lines = [await open_async_line(port, slink3.LINE) for port in ports]
    seen: list[Polls] = [array("d") for _ in lines]
    chosen = list(range(0, len(lines), len(lines) // ALONE))[:ALONE]
    before = [await polls(lines[at], seconds / 4, seen[at]) for at in chosen[::2]]
    used, started = process_time(), monotonic()
    together = await asyncio.gather(
        *(polls(lines[at], seconds, seen[at], at / LIMIT / len(lines)) for at in range(len(lines)))
    )
    ended = monotonic()
    used = (process_time() - used) / (ended - started)
    after = [await polls(lines[at], seconds / 4, seen[at]) for at in chosen[1::2]]
    for line in lines:
        await line.close()
    period = [started + 2 * SETTLE, ended]
    alone = before + after
    return {
        "alone": alone,
        "together": together,
        "core": used,
        "period": period,
        "seen": [list(zip(times[::2], times[1::2], strict=True)) for times in seen],
    }


def run(count: int, burst_ms: float, seconds: float) -> dict[str, Any]:
    """One round: masters on one core, the simulator on another."""
    masters_core, simulator_core = sorted(os.sched_getaffinity(0))[:2]
    simulator = start("many_simulated", str(simulator_core), str(count), str(burst_ms), "flexmax")
    masters = start("many_lines", str(masters_core), str(seconds))
    assert simulator.stdin is not None
    assert masters.stdin is not None
    try:
        print(line_of(simulator.stdout), file=masters.stdin, flush=True)
        found: dict[str, Any] = json.loads(line_of(masters.stdout))
        print("report", file=simulator.stdin, flush=True)
        found["parts"] = parts(found, json.loads(line_of(simulator.stdout)))
        return found
    finally:
        masters.communicate()
        simulator.communicate()


def parts(found: dict[str, Any], noted: list[list[list[float]]]) -> dict[str, float]:
    """What a poll took beyond the line's own time while all were polled: the mean of each part, ms."""
    times: dict[str, list[float]] = {"request": [], "answer": [], "receipt": [], "rest": []}
    begin, end = found["period"]
    for seen, line in zip(found["seen"], noted, strict=True):
        assert len(seen) == len(line), "a read was repeated"
        for at in range(len(seen) - 1):
            asked, received = seen[at]
            came, due, out = line[at]
            if not begin < asked < end - SETTLE:
                continue
            times["request"].append(came - asked)
            times["answer"].append(out - due)
            times["receipt"].append(received - out)
            times["rest"].append(seen[at + 1][0] - received - slink3.LINE.gap)
    return {name: mean(values) * 1000 for name, values in times.items()}


def many_lines(quick: bool) -> list[Result]:
    rounds, seconds = (1, 3.0) if quick else (3, 6.0)
    found: dict[tuple[int, float], list[dict[str, Any]]] = {case: [] for case in CASES}
    for _ in range(rounds):
        for (count, burst), series in found.items():
            series.append(run(count, burst, seconds))
    return [_result(count, burst, series) for (count, burst), series in found.items()]


def _result(count: int, burst: float, series: list[dict[str, Any]]) -> Result:
    worst = median(min(run["together"]) / median(run["alone"]) for run in series)
    typical = median(median(run["together"]) / median(run["alone"]) for run in series)
    alone = median(median(run["alone"]) for run in series)
    part = {name: median(run["parts"][name] for run in series) for name in series[0]["parts"]}
    how = f"in bursts of {burst:g} ms" if burst else "byte by byte"
    return Result(
        f"{count} paced 9600-baud lines in one process on one core, answers {how}",
        "each line alone",
        ">= 0.97 of its polls, every line",
        f"{worst:.3f}",
        worst >= 0.97,
        [
            f"the slowest line {worst:.3f}, the median line {typical:.3f} of a line alone, "
            f"which makes {alone:.2f} polls a second of the {LIMIT:.2f} that 9600 baud allows",
            f"the masters use {median(run['core'] for run in series):.0%} of their core",
            f"a poll takes {sum(part.values()):.2f} ms more than the line's own {OWN_TIME * 1000:.1f} ms: "
            f"{part['request']:.2f} until the simulator has the request, "
            f"{part['answer']:.2f} the simulator's last byte is late, "
            f"{part['receipt']:.2f} until the master has it, {part['rest']:.2f} rest beyond 2 ms",
        ],
    )


if __name__ == "__main__":
    os.sched_setaffinity(0, {int(sys.argv[1])})
    print(json.dumps(asyncio.run(measure(json.loads(sys.stdin.readline()), float(sys.argv[2])))))
