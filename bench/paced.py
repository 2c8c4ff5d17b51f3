"""Typed reads in a row on a paced 9600 8E1 line: what a read costs beyond the line's own time."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median
from time import monotonic

from bench.measure import Result, line_of, percentile, start
from multidrop.io.line import Line
from multidrop.io.ports import Port, PortSetup, open_port
from multidrop.naming import LineOptions
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Format, Master

READS = 200
ON_THE_LINE = (11 + 13) * slink3.LINE.character  # s: request and answer
OWN_TIME = ON_THE_LINE + slink3.LINE.gap  # s: and the rest before the next request
KINDS = {"TCP": "tcp://127.0.0.1:0", "pty": "pty"}
BURSTS = (0.0, 1.0, 16.0)  # ms


class StampedPort:
    """A port that notes when it is told to send."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self.network, self.marks = port.network, port.marks
        self.now, self.read, self.close = port.now, port.read, port.close
        self.sent: list[float] = []

    def write(self, data: bytes) -> None:
        self.sent.append(monotonic())
        self._port.write(data)


@dataclass(frozen=True, slots=True)
class Reads:
    """Of each read in a row, in ms: time beyond the line's own, and the simulator's part of it."""

    beyond: list[float]
    late: list[float]
    shortest_gap: float  # from the last byte of an answer to the next request, at the simulator

    @property
    def own(self) -> list[float]:
        return [beyond - late for beyond, late in zip(self.beyond, self.late, strict=True)]


@contextmanager
def simulated(
    kind: str, burst_ms: float, profile: str = "flexmax"
) -> Iterator[tuple[str, list[tuple[float, float]]]]:
    """A line in a process of its own: its port, and after the block what it noted of each request."""
    process = start("simulator", profile, KINDS[kind], str(burst_ms))
    assert process.stdin is not None
    noted: list[tuple[float, float]] = []
    try:
        yield json.loads(line_of(process.stdout)), noted
        print("report", file=process.stdin, flush=True)
        noted.extend(json.loads(line_of(process.stdout)))
    finally:
        process.communicate()


def reads(kind: str, burst_ms: float, count: int) -> Reads:
    """`count` reads in a row, after one that does not count."""
    master = Master(0)
    finished: list[float] = []
    with simulated(kind, burst_ms) as (name, noted):
        port = StampedPort(open_port(name, PortSetup(slink3.LINE, LineOptions())))
        with Line(port, slink3.LINE) as line:
            for _ in range(count + 1):
                line.run(master.read_typed(8236, Format.SHORT_INT))
                finished.append(monotonic())
    assert len(noted) == len(port.sent) == count + 1, "a read was repeated"
    beyond, late, gaps = [], [], []
    for at in range(1, count + 1):
        came, out = noted[at]
        beyond.append((finished[at] - finished[at - 1] - OWN_TIME) * 1000)
        late.append((came - port.sent[at] + out - came - ON_THE_LINE) * 1000)
        gaps.append((came - noted[at - 1][1]) * 1000)
    return Reads(beyond, late, min(gaps))


def paced(quick: bool) -> list[Result]:
    rounds = 1 if quick else 5
    found: dict[tuple[str, float], list[Reads]] = {
        (kind, burst): [] for kind in KINDS for burst in BURSTS
    }
    for _ in range(rounds):
        for (kind, burst), series in found.items():
            series.append(reads(kind, burst, READS))
    return [_result(kind, [found[kind, burst] for burst in BURSTS]) for kind in KINDS]


def _result(kind: str, series: list[list[Reads]]) -> Result:
    smooth = series[0]
    middle, high = _both([run.own for run in smooth])
    shortest = min(run.shortest_gap for runs in series for run in runs)
    beside = []
    for burst, runs in zip(BURSTS, series, strict=True):
        how = f"bursts of {burst:g} ms" if burst else "byte by byte"
        beside.append(
            f"{how}: own {_shown([run.own for run in runs])}, "
            f"simulator late {_shown([run.late for run in runs])}, "
            f"both {_shown([run.beyond for run in runs])}"
        )
    return Result(
        f"typed read on a paced 9600 8E1 line, 200 in a row, {kind}",
        f"the line's own {OWN_TIME * 1000:.1f} ms",
        "<= 0.3 ms median, <= 2.5 ms 99th percentile",
        f"{middle:.2f} ms, {high:.2f} ms",
        middle <= 0.3 and high <= 2.5,
        [
            *beside,
            f"shortest rest between answer and request, seen by the simulator: {shortest:.3f} ms",
        ],
    )


def _both(runs: list[list[float]]) -> tuple[float, float]:
    """Median and 99th percentile of each run; of those the medians."""
    return (
        median(percentile(run, 0.5) for run in runs),
        median(percentile(run, 0.99) for run in runs),
    )


def _shown(runs: list[list[float]]) -> str:
    middle, high = _both(runs)
    return f"{middle:.2f} / {high:.2f} ms"
