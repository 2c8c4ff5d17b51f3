"""Reads through `multidrop share`: what it adds to a read beyond the line's own time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from statistics import median
from time import monotonic

from bench.measure import Result, line_of, percentile
from bench.paced import ON_THE_LINE, READS, StampedPort, simulated
from multidrop.io.line import Line
from multidrop.io.ports import PortSetup, open_port
from multidrop.naming import LineOptions
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Format, Master


def share(quick: bool) -> list[Result]:
    """Each read of a row, directly and through `share` in turns; the simulator's time taken off."""
    rounds = 1 if quick else 5
    direct: list[list[float]] = []
    through: list[list[float]] = []
    for _ in range(rounds):
        direct.append(_reads(shared=False))
        through.append(_reads(shared=True))
    middle, high = _both(through)
    own_middle, own_high = _both(direct)
    return [
        Result(
            f"typed read through share on a paced 9600 8E1 line, {READS} in a row, TCP",
            f"the line's own {ON_THE_LINE * 1000:.1f} ms",
            "< 1 ms median",
            f"{middle:.2f} ms, {high:.2f} ms",
            middle < 1.0,
            [f"the same without share: {own_middle:.2f} / {own_high:.2f} ms"],
        )
    ]


def _both(runs: list[list[float]]) -> tuple[float, float]:
    """Median and 99th percentile of each run; of those the medians."""
    return (
        median(percentile(run, 0.5) for run in runs),
        median(percentile(run, 0.99) for run in runs),
    )


def _reads(*, shared: bool) -> list[float]:
    """ms of each read beyond the time from request to answer at the simulator."""
    master = Master(0)
    finished: list[float] = []
    with (
        simulated("TCP", 0.0) as (name, noted),
        _sharing(name) if shared else nullcontext(name) as where,
    ):
        port = StampedPort(open_port(where, PortSetup(slink3.LINE, LineOptions())))
        with Line(port, slink3.LINE) as line:
            for _ in range(READS + 1):
                line.run(master.read_typed(8236, Format.SHORT_INT))
                finished.append(monotonic())
    assert len(noted) == len(port.sent) == READS + 1, "a read was repeated"
    return [
        (end - sent - (out - came)) * 1000
        for end, sent, (came, out) in list(zip(finished, port.sent, noted, strict=True))[1:]
    ]


@contextmanager
def _sharing(port: str) -> Iterator[str]:
    """`multidrop share` in a process of its own."""
    command = ["-m", "multidrop", "share", port, "--listen", "tcp://127.0.0.1:0"]
    process = subprocess.Popen(
        [sys.executable, *command, "--protocol", "slink3"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        yield line_of(process.stdout).removeprefix("listening on ")
    finally:
        process.terminate()
        process.communicate()
