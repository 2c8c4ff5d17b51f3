"""`multidrop run` on a plant of 2,000 points, read once a second over 20 lines that take no time.

Everything is switched on: history, freeze-frames, page, and MQTT where there is a broker.
"""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median

from bench.gateway_plants import (
    ALONE,
    DEVICES,
    MIXED,
    Kind,
    counted_of,
    large,
    lines_of,
    messages_of,
    points_of,
)
from bench.gateway_process import (
    GatewayProcess,
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
from bench.measure import Result, percentile

BROWSERS = 100
SETTLE = 3.0  # s that do not count, once every line has answered
GOAL_CORE, GOAL_MEMORY, GOAL_LATENCY, GOAL_POLLS = 0.5, 200.0, 50.0, 0.99
ARRIVED = 0.97
"""Share of the polled values that must have come: at the ends of the time some are on their way."""
GROWTH = 1.0
"""MB in the second half of the time that pass for nothing: an allocator gives and takes."""

OF = f"{points_of(MIXED):,} points a second, every value new, of {DEVICES * 20} devices on 20 unpaced TCP lines"


@dataclass(frozen=True, slots=True)
class Plant:
    """A plant that is simulated, and the gateway on it. `mqtt` is the port of its broker."""

    simulator: subprocess.Popen[str]
    process: GatewayProcess
    mqtt: int | None
    folder: Path
    rest: int  # the core of whatever is neither gateway nor simulator

    def answers(self) -> int:
        """How many the simulator has given."""
        return sum(asked(self.simulator, "count"))

    def polled(self, seconds: float) -> tuple[float, float]:
        """Answers a second, and the share of a core, from now on."""
        answers, used, begin = self.answers(), self.process.used, time.monotonic()
        time.sleep(seconds)
        took = time.monotonic() - begin
        return (self.answers() - answers) / took, (self.process.used - used) / took


@contextlib.contextmanager
def running(
    kinds: tuple[Kind, ...] = MIXED, *, full: bool = False, outbox: bool = False
) -> Iterator[Plant]:
    """The plant, once every line is polled."""
    own, simulator, rest = cores()
    lines = lines_of(kinds)
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        of_lines = [kind.counted for kind in lines]
        process, ports = stack.enter_context(
            simulated("unpaced_simulated", simulator, DEVICES, *of_lines)
        )
        mqtt = stack.enter_context(broker(folder, rest))
        file = large(folder, ports, kinds, mqtt, outbox=outbox)
        plant = Plant(
            process, stack.enter_context(gateway(file, own, full=full)), mqtt, folder, rest
        )
        wait_until(lambda: min(asked(process, "count")) > 0)
        time.sleep(SETTLE)
        yield plant


# -- from the wire to those who are told ---------------------------------------------------------


def rows(quick: bool) -> list[Result]:
    seconds = 5.0 if quick else 30.0
    with running() as plant:
        found = [*_told(plant, seconds), *_browsers(plant, quick)]
    return [*found, *_outbox(seconds)]


def _outbox(seconds: float) -> list[Result]:
    """What it costs that the broker confirms every state: in turns without an outbox and with one."""
    if mqtt_missing() is not None:
        return []
    shares: dict[bool, list[float]] = {False: [], True: []}
    came: list[float] = []
    expected = 0.0
    for outbox in (False, True, False, True):
        with running(outbox=outbox) as plant:
            assert plant.mqtt is not None
            states = Subscriber(plant.mqtt, plant.folder, plant.rest)
            time.sleep(1.0)
            begin = time.monotonic()
            polls, core = plant.polled(seconds)
            end = time.monotonic()
            time.sleep(1.0)
            shares[outbox].append(core)
            told, noted = states.end(), asked(plant.simulator, "report")
        if outbox:
            came += latencies(told, noted, begin, end)
            expected += counted_of(MIXED) * (end - begin) * polls / messages_of(MIXED)
    without, with_it = (mean(shares[outbox]) for outbox in (False, True))
    beside = [f"{without:.0%} of a core with QoS 0, {with_it:.0%} with QoS 1 and an outbox"]
    who = "an MQTT subscriber, with QoS 1 and an outbox"
    return [_latency(who, came, expected, beside)]


def _told(plant: Plant, seconds: float) -> list[Result]:
    states = None if plant.mqtt is None else Subscriber(plant.mqtt, plant.folder, plant.rest)
    with simulated("browsers", plant.rest, plant.process.http, 1) as (browser, _):
        time.sleep(1.0)
        asked(browser, "told")  # what it was told first is of before
        begin = time.monotonic()
        polls, core = plant.polled(seconds)
        end = time.monotonic()
        time.sleep(1.0)
        told = asked(browser, "told")
    noted = asked(plant.simulator, "report")
    beside = [f"{polls:.0f} polls a second; {core:.0%} of a core"]
    expected = counted_of(MIXED) * (end - begin) * polls / messages_of(MIXED)
    found = [_latency("a browser", latencies(told, noted, begin, end), expected, beside)]
    if states is None:
        print(f"MQTT is not measured: {mqtt_missing()}")
        return found
    came = latencies(states.end(), noted, begin, end)
    return [*found, _latency("an MQTT subscriber", came, expected, beside)]


def _latency(who: str, found: list[float], expected: float, beside: list[str]) -> Result:
    high = percentile(found, 0.99)
    return Result(
        f"{OF}: from the end of an answer on the wire to {who}",
        "",
        f"< {GOAL_LATENCY:.0f} ms in the 99th percentile",
        f"{high:.1f} ms",
        high < GOAL_LATENCY and len(found) > ARRIVED * expected,
        [
            f"{len(found):,} of {expected:,.0f} values, median {median(found):.1f} ms, longest {max(found):.0f} ms",
            *beside,
        ],
    )


def _browsers(plant: Plant, quick: bool) -> list[Result]:
    """In turns without them and with them."""
    seconds, rounds = (4.0, 1) if quick else (10.0, 3)
    without, with_them, told = [], [], []
    for _ in range(rounds):
        without.append(plant.polled(seconds))
        with simulated("browsers", plant.rest, plant.process.http, BROWSERS) as (browsers, _):
            time.sleep(1.0)
            asked(browsers, "told")
            begin = time.monotonic()
            with_them.append(plant.polled(seconds))
            end = time.monotonic()
            told += latencies(
                asked(browsers, "told"), asked(plant.simulator, "report"), begin, end - 1.0
            )
        time.sleep(1.0)
    share = median(mine[0] / other[0] for mine, other in zip(with_them, without, strict=True))
    cores_used = [f"{mean(core for _, core in found):.0%}" for found in (without, with_them)]
    return [
        Result(
            f"{OF}: polls made while {BROWSERS} browsers listen to all values",
            "the same without them",
            f">= {GOAL_POLLS}",
            f"{share:.3f}",
            share >= GOAL_POLLS,
            [
                f"{' and '.join(cores_used)} of a core without and with them",
                f"from the wire to one of them: {shown(told)}",
            ],
        )
    ]


# -- ten minutes ---------------------------------------------------------------------------------


def memory(quick: bool) -> list[Result]:
    """What the gateway takes for ten minutes (quick: half a minute)."""
    seconds, every = (30, 1) if quick else (600, 5)
    resident = []
    with running() as plant:
        answers, used, begin = plant.answers(), plant.process.used, time.monotonic()
        for _ in range(seconds // every):
            time.sleep(every)
            resident.append(plant.process.resident)
        took = time.monotonic() - begin
        polls = (plant.answers() - answers) / took
        core = (plant.process.used - used) / took
    tenth = len(resident) // 10
    half, last = median(resident[5 * tenth : 6 * tenth]), median(resident[-tenth:])
    made = polls / messages_of(MIXED)
    with running(ALONE, full=True) as plant:
        alone, alone_core = plant.polled(5.0 if quick else 30.0)
    return [
        Result(
            f"{OF}, {seconds / 60:g} minutes: processor and memory of the gateway",
            "",
            f"< {GOAL_CORE} of a core, < {GOAL_MEMORY:.0f} MB, growing by nothing",
            f"{core:.2f}, {max(resident):.0f} MB, {last - half:+.1f} MB in the second half",
            core < GOAL_CORE
            and max(resident) < GOAL_MEMORY
            and last - half < GROWTH
            and made > GOAL_POLLS,
            [
                f"{polls:.0f} polls a second, {made:.3f} of the plan; {_minutes(resident)}",
                f"as many points of FlexMax alone, each a message of its own: {alone_core:.2f} of a "
                f"core, {alone:.0f} polls a second of {messages_of(ALONE):,}",
                "with history, freeze-frames, page and MQTT"
                if mqtt_missing() is None
                else f"with history, freeze-frames and page; no MQTT: {mqtt_missing()}",
            ],
        )
    ]


def _minutes(resident: list[float]) -> str:
    """At ten times."""
    step = max(1, len(resident) // 10)
    return ", ".join(f"{one:.0f}" for one in resident[step - 1 :: step]) + " MB as time went by"
