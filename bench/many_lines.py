"""Many paced lines in one process on one core, each against itself alone.

`python -m bench.many_lines CPU SECONDS` is that process: it reads the ports as a
line of JSON, polls some of the lines one at a time, then all of them together,
and prints the polls a second of each.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from statistics import median
from time import monotonic, process_time

from bench.measure import Result, line_of, start
from multidrop.io.async_line import AsyncLine, open_async_line
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Format, Master

LINES = 200
ALONE = 6  # lines that are also polled alone
SETTLE = 0.5  # s that do not count
LIMIT = 1 / ((11 + 13) * slink3.LINE.character + slink3.LINE.gap)  # polls a second


async def polls(line: AsyncLine, seconds: float, phase: float = 0.0) -> float:
    """Polls a second of a line that is read without a pause, once it has settled.

    Lines that start in step queue behind each other at first: each has its phase.
    """
    await asyncio.sleep(phase)
    master = Master(0)
    begin = monotonic() + SETTLE
    first = last = 0.0
    count = -1  # the first only starts the clock
    while last < begin + seconds:
        await line.run(master.read_typed(8236, Format.SHORT_INT))
        last = monotonic()
        if last >= begin:
            first = first or last
            count += 1
    return count / (last - first)


async def measure(ports: list[str], seconds: float) -> dict[str, list[float]]:
    """Some lines alone, all together, some others alone."""
    lines = [await open_async_line(port, slink3.LINE) for port in ports]
    chosen = lines[:: len(lines) // ALONE][:ALONE]
    before = [await polls(line, seconds / 4) for line in chosen[::2]]
    used = process_time()
    started = monotonic()
    together = await asyncio.gather(
        *(polls(line, seconds, at / LIMIT / len(lines)) for at, line in enumerate(lines))
    )
    used = (process_time() - used) / (monotonic() - started)
    after = [await polls(line, seconds / 4) for line in chosen[1::2]]
    for line in lines:
        await line.close()
    return {"alone": before + after, "together": together, "core": [used]}


def run(burst_ms: float, seconds: float) -> dict[str, list[float]]:
    """One round: masters on one core, the simulator on another."""
    masters_core, simulator_core = sorted(os.sched_getaffinity(0))[:2]
    simulator = start("simulator", "many", str(LINES), str(burst_ms), str(simulator_core))
    masters = start("many_lines", str(masters_core), str(seconds))
    assert simulator.stdin is not None
    assert masters.stdin is not None
    try:
        print(line_of(simulator.stdout), file=masters.stdin, flush=True)
        found: dict[str, list[float]] = json.loads(line_of(masters.stdout))
        print("report", file=simulator.stdin, flush=True)
        found["late"] = json.loads(line_of(simulator.stdout))
        return found
    finally:
        masters.communicate()
        simulator.communicate()


def many_lines(quick: bool) -> list[Result]:
    rounds, seconds = (1, 3.0) if quick else (5, 8.0)
    found: dict[float, list[dict[str, list[float]]]] = {0.0: [], 16.0: []}
    for _ in range(rounds):
        for burst, series in found.items():
            series.append(run(burst, seconds))
    return [_result(burst, series) for burst, series in found.items()]


def _result(burst: float, series: list[dict[str, list[float]]]) -> Result:
    worst = median(min(run["together"]) / median(run["alone"]) for run in series)
    typical = median(median(run["together"]) / median(run["alone"]) for run in series)
    alone = median(median(run["alone"]) for run in series)
    late = [median(run["late"][at] for run in series) * 1000 for at in (0, 1)]
    how = f"in bursts of {burst:g} ms" if burst else "byte by byte"
    return Result(
        f"{LINES} paced 9600-baud lines in one process on one core, answers {how}",
        "each line alone",
        ">= 0.97 of its polls, every line",
        f"{worst:.3f}",
        worst >= 0.97,
        [
            f"the slowest line {worst:.3f}, the median line {typical:.3f} of a line alone, "
            f"which makes {alone:.2f} polls a second of the {LIMIT:.2f} that 9600 baud allows",
            f"the masters use {median(run['core'][0] for run in series):.0%} of their core; "
            f"the simulator is {late[0]:.2f} ms late in the median, {late[1]:.2f} ms in the 99th percentile",
        ],
    )


if __name__ == "__main__":
    os.sched_setaffinity(0, {int(sys.argv[1])})
    print(json.dumps(asyncio.run(measure(json.loads(sys.stdin.readline()), float(sys.argv[2])))))
