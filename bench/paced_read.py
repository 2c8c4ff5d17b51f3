"""Reads in a row on a paced line of any protocol: what a read costs beyond the line's own time.

`python -m bench.paced_read PROFILE ANSWER LISTEN BURST_MS` serves the simulated
device of a profile at address 0 as `bench.simulator` does; an answer has
ANSWER bytes.
"""

from __future__ import annotations

import asyncio
import json
import sys
from dataclasses import dataclass
from time import monotonic

from bench.measure import Result, line_of, start
from bench.paced import BURSTS, KINDS, READS, Reads, StampedPort, _both, _shown
from bench.simulator import Watched
from multidrop.catalog import load_profile
from multidrop.io.line import Line
from multidrop.io.ports import PortSetup, open_port
from multidrop.naming import LineOptions
from multidrop.protocols import PROTOCOLS
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Pace, SimulatedLine
from multidrop.sim.serve import serve
from multidrop.timing import LineSettings


@dataclass(frozen=True, slots=True)
class PacedRead:
    """A read of one point of a profile, and the bytes of its request and of its answer."""

    profile: str
    point: str
    request: int
    answer: int

    @property
    def line(self) -> LineSettings:
        return PROTOCOLS[load_profile(self.profile).protocol].line

    @property
    def on_the_line(self) -> float:
        """s of request and answer."""
        return (self.request + self.answer) * self.line.character


def paced_read(read: PacedRead, quick: bool) -> list[Result]:
    """The same row as SLINK3's, over TCP and over a pseudo-terminal."""
    found: dict[tuple[str, float], list[Reads]] = {
        (kind, burst): [] for kind in KINDS for burst in BURSTS
    }
    for _ in range(1 if quick else 5):
        for (kind, burst), series in found.items():
            series.append(reads(read, kind, burst))
    return [_result(read, kind, [found[kind, burst] for burst in BURSTS]) for kind in KINDS]


def reads(read: PacedRead, kind: str, burst_ms: float) -> Reads:
    """`READS` reads in a row, after one that does not count."""
    settings = read.line.with_options(timeout=1.0)  # a simulator that stalls is no silent device
    own = read.on_the_line + read.line.gap
    device = PROTOCOLS[load_profile(read.profile).protocol].device(
        0, load_profile(read.profile), {}
    )
    point = device.point(read.point)
    finished: list[float] = []
    process = start("paced_read", read.profile, str(read.answer), KINDS[kind], str(burst_ms))
    assert process.stdin is not None
    try:
        name = json.loads(line_of(process.stdout))
        port = StampedPort(open_port(name, PortSetup(settings, LineOptions())))
        with Line(port, settings) as line:
            line.run(device.read(point))  # Datalink looks at its map before
            port.sent.clear()
            for _ in range(READS + 1):
                line.run(device.read(point))
                finished.append(monotonic())
        print("report", file=process.stdin, flush=True)
        noted = json.loads(line_of(process.stdout))[-READS - 1 :]
    finally:
        process.communicate()
    assert len(noted) == len(port.sent) == READS + 1, "a read was repeated"
    beyond, late, gaps = [], [], []
    for at in range(1, READS + 1):
        came, out = noted[at]
        beyond.append((finished[at] - finished[at - 1] - own) * 1000)
        late.append((came - port.sent[at] + out - came - read.on_the_line) * 1000)
        gaps.append((came - noted[at - 1][1]) * 1000)
    return Reads(beyond, late, min(gaps))


def _result(read: PacedRead, kind: str, series: list[list[Reads]]) -> Result:
    middle, high = _both([run.own for run in series[0]])
    beside = []
    for burst, runs in zip(BURSTS, series, strict=True):
        how = f"bursts of {burst:g} ms" if burst else "byte by byte"
        beside.append(
            f"{how}: own {_shown([run.own for run in runs])}, "
            f"simulator late {_shown([run.late for run in runs])}, "
            f"both {_shown([run.beyond for run in runs])}"
        )
    line = read.line
    return Result(
        f"{read.profile} {read.point} on a paced {line.baud} {line.format} line, "
        f"{READS} in a row, {kind}",
        f"the line's own {(read.on_the_line + line.gap) * 1000:.1f} ms",
        "<= 0.3 ms median, <= 2.5 ms 99th percentile",
        f"{middle:.2f} ms, {high:.2f} ms",
        middle <= 0.3 and high <= 2.5,
        beside,
    )


class _Watched(Watched):
    """An end whose answers have as many bytes as its line says."""

    def receive(self, data: bytes, now: float) -> None:
        super().receive(data, now)
        assert isinstance(self._line, _WatchedLine)
        self._left = self._line.answer


class _WatchedLine(SimulatedLine):
    def __init__(self, profile: str, answer: int, burst_ms: float) -> None:
        line = PROTOCOLS[load_profile(profile).protocol].line
        pace = Pace(line.character, burst_ms / 1000)
        super().__init__([simulated_device(profile, 0)], line.decoder, pace=pace)
        self.answer = answer
        self.ends: list[_Watched] = []

    def attach(self) -> _Watched:
        end = _Watched(self, self._decoder())
        self.ends.append(end)
        return end


async def _serve(profile: str, answer: str, listen: str, burst_ms: str) -> None:
    line = _WatchedLine(profile, int(answer), float(burst_ms))
    listener = await serve(line, listen, spin=True)
    print(json.dumps(listener.port), flush=True)
    loop = asyncio.get_running_loop()
    while await loop.run_in_executor(None, sys.stdin.readline):
        print(json.dumps([read for end in line.ends for read in end.passed]), flush=True)
    listener.close()


if __name__ == "__main__":
    asyncio.run(_serve(*sys.argv[1:]))
