"""64 paced lines of all three protocols, each with a line service, in one process on one core.

`python -m bench.service_lines CPU SECONDS` is that process: it reads the ports as a
line of JSON, polls all lines as fast as they go, then changes the instruments'
setpoints too, and prints the polls a second of each line and what became of the writes.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import os
import sys
import tempfile
from bisect import bisect_left
from dataclasses import dataclass
from statistics import median
from time import monotonic, process_time
from typing import Any

from bench.measure import Result, line_of, percentile, start
from multidrop.errors import Error
from multidrop.io.connection import Target
from multidrop.io.polling import wire_time
from multidrop.io.service import LineService, Polled

LINES = 64
BAUD = 9600
SETTLE = 1.5  # s that do not count: a Datalink instrument's map is looked at first
FASTER = 0.01  # s, the period of a poll: shorter than it takes, so that the line is always full
WRITE_EVERY = 0.5  # s
ACKNOWLEDGED_WITHIN = 0.080
"""s after the echo: later, multidrop drops the change instead."""


@dataclass(frozen=True, slots=True)
class Kind:
    """What is polled of a device: two polls, as long as each other."""

    profile: str
    points: tuple[str, ...]
    written: str = ""

    @property
    def name(self) -> str:
        return f"{self.profile}:0"


KINDS = (
    Kind("flexmax", ("8236:int16", "actual_speed")),
    Kind("53mc5000", ("C100..C109", "C120..C129"), "C250"),
    Kind("ultra3000", ("setpoint_velocity", "motor_position")),
)


def kind_of(line: int) -> Kind:
    return KINDS[line % len(KINDS)]


def limit(kind: Kind) -> float:
    """Polls a second that the line allows: characters and the rest between answer and request."""
    target = Target.of(f"{kind.name}@wire,baud={BAUD}")
    device, settings = target.device(), target.settings
    points = [point for text in kind.points for point in device.points(text)]
    groups = device.plan(points)
    seconds = sum(wire_time(settings, device.sizes(group)) + settings.gap for group in groups)
    return len(groups) / seconds


class Line:
    """One line and its service."""

    def __init__(self, number: int, port: str) -> None:
        self.kind = kind_of(number)
        self.service = LineService({"it": f"{self.kind.name}@{port},baud={BAUD},timeout=1"})
        self.count = 0
        self.bad = 0

    async def poll(self, phase: float) -> None:
        await asyncio.sleep(phase)
        plan = self.service.plan([("it", self.kind.points, FASTER)])
        first = {poll.group[0] for poll in plan.polls}

        def count(polled: Polled) -> None:
            if polled.point in first:
                self.count += polled.good
            self.bad += not polled.good

        await self.service.poll(plan, count)

    async def write(self, phase: float) -> int:
        """Change one point again and again; returns how many changes were not confirmed."""
        await asyncio.sleep(phase)
        failed, value = 0, 0
        try:
            while True:
                value = (value + 1) % 90
                try:
                    await self.service.write("it", self.kind.written, value)
                except Error as error:
                    print(f"a change failed: {error}", file=sys.stderr)
                    failed += 1
                await asyncio.sleep(WRITE_EVERY)
        except asyncio.CancelledError:
            return failed


async def measure(ports: list[str], seconds: float) -> dict[str, Any]:
    lines = [Line(number, port) for number, port in enumerate(ports)]
    for line in lines:
        await line.service.__aenter__()
    tasks = [
        asyncio.create_task(line.poll(0.05 * at / len(lines))) for at, line in enumerate(lines)
    ]
    await asyncio.sleep(SETTLE)
    before, used, begin = [line.count for line in lines], process_time(), monotonic()
    await asyncio.sleep(seconds)
    end = monotonic()
    rates = [(line.count - was) / (end - begin) for line, was in zip(lines, before, strict=True)]
    core = (process_time() - used) / (end - begin)
    instruments = [line for line in lines if line.kind.written]
    writers = [
        asyncio.create_task(line.write(WRITE_EVERY * at / len(instruments)))
        for at, line in enumerate(instruments)
    ]
    await asyncio.sleep(seconds)
    for writer in writers:
        writer.cancel()
    failed = sum(await asyncio.gather(*writers))
    for task in tasks:
        if task.done():
            task.result()
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    await asyncio.sleep(0.3)  # answers that are on their way
    for line in lines:
        await line.service.close()
    bad = sum(line.bad for line in lines)
    return {"rates": rates, "core": core, "failed": failed, "bad": bad, "period": [begin, end]}


def run(seconds: float) -> dict[str, Any]:
    """One round: the services on one core, the simulator on another."""
    own_core, simulator_core = sorted(os.sched_getaffinity(0))[:2]
    profiles = [f"{kind.profile}@{BAUD}" for kind in KINDS]
    simulator = start("many_simulated", str(simulator_core), str(LINES), "0", *profiles)
    services = start("service_lines", str(own_core), str(seconds))
    assert simulator.stdin is not None
    assert services.stdin is not None
    try:
        print(line_of(simulator.stdout), file=services.stdin, flush=True)
        found: dict[str, Any] = json.loads(line_of(services.stdout))
        print("report", file=simulator.stdin, flush=True)
        noted = json.loads(line_of(simulator.stdout))
        print("unanswered", file=simulator.stdin, flush=True)
        unanswered = json.loads(line_of(simulator.stdout))
    finally:
        services.communicate()
        simulator.communicate()
    drives = [answers for number, answers in enumerate(noted) if kind_of(number) is KINDS[0]]
    found["gap"] = min(
        after[0] - before[2] for answers in drives for before, after in itertools.pairwise(answers)
    )
    found["acknowledged"] = [
        acknowledged
        for number, times in enumerate(unanswered)
        if kind_of(number).written
        for acknowledged in _since_answer(times, [answer[2] for answer in noted[number]])
    ]
    return found


def _since_answer(times: list[float], out: list[float]) -> list[float]:
    """From the last byte of the answer before each of these messages (the echo of a change), s."""
    return [at - out[bisect_left(out, at) - 1] for at in times]


def service_lines(quick: bool) -> list[Result]:
    series = [run(4.0 if quick else 10.0) for _ in range(1 if quick else 3)]
    shares = {
        kind.profile: median(
            min(
                rate / limit(kind)
                for number, rate in enumerate(found["rates"])
                if kind_of(number) is kind
            )
            for found in series
        )
        for kind in KINDS
    }
    worst = min(shares.values())
    gap = min(found["gap"] for found in series) * 1000
    within = [at * 1000 for found in series for at in found["acknowledged"]]
    failed = sum(found["failed"] for found in series)
    late = sum(at > ACKNOWLEDGED_WITHIN * 1000 for at in within)
    high = percentile(within, 0.99)
    core = median(found["core"] for found in series)
    each_poll = median(found["core"] / sum(found["rates"]) for found in series) * 1e6
    bad = sum(found["bad"] for found in series)
    of = f"{LINES} paced {BAUD}-baud lines of three protocols, a line service each, one core"
    each = ", ".join(
        f"{profile} {share:.3f} of {limit(kind):.1f} a second"
        for kind, (profile, share) in zip(KINDS, shares.items(), strict=True)
    )
    return [
        Result(
            of,
            "each line's own limit",
            ">= 0.97 of it, every line",
            f"{worst:.3f}",
            worst >= 0.97,
            [
                f"the slowest of each: {each}",
                f"{core:.0%} of the core, {each_poll:.0f} µs of it a poll; {bad} polls failed",
            ],
        ),
        Result(
            f"{of}: rest before a request of a FlexMax",
            "the 2 ms that it asks for",
            "never shorter",
            f"{gap:.3f} ms",
            gap >= 2.0,
            ["seen by the simulator: from the last byte handed over to the first that came"],
        ),
        Result(
            f"{of}: from the echo of a Datalink change to its Acknowledge",
            "100 ms, after which an instrument drops it",
            "< 20 ms in the 99th percentile, none late",
            f"{high:.1f} ms, {late + failed} late",
            high < 20.0 and late + failed == 0,
            [
                f"{len(within)} changes, median {median(within):.2f} ms, longest {max(within):.1f} ms;"
                f" {failed} not confirmed"
            ],
        ),
    ]


if __name__ == "__main__":
    os.sched_setaffinity(0, {int(sys.argv[1])})
    with tempfile.TemporaryDirectory() as folder:
        os.environ["MULTIDROP_AUDIT"] = f"{folder}/audit.jsonl"
        print(
            json.dumps(asyncio.run(measure(json.loads(sys.stdin.readline()), float(sys.argv[2]))))
        )
