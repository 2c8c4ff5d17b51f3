"""Reads in a row on a paced line of any protocol: what a read costs beyond the line's own time."""

from __future__ import annotations

from dataclasses import dataclass
from time import monotonic

from bench.measure import Result
from bench.paced import BURSTS, KINDS, READS, Reads, StampedPort, _both, _shown, simulated
from multidrop.catalog import load_profile
from multidrop.io.line import Line
from multidrop.io.ports import PortSetup, open_port
from multidrop.naming import LineOptions
from multidrop.protocols import PROTOCOLS
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
    with simulated(kind, burst_ms, read.profile) as (name, everything):
        port = StampedPort(open_port(name, PortSetup(settings, LineOptions())))
        with Line(port, settings) as line:
            line.run(device.read(point))  # Datalink looks at its map before
            port.sent.clear()
            for _ in range(READS + 1):
                line.run(device.read(point))
                finished.append(monotonic())
    noted = everything[-READS - 1 :]
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
