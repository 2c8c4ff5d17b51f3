"""Discoveries on paced lines: how well `multidrop discover` foretells the time that it takes."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import monotonic

from bench.measure import Result, line_of
from bench.scan import COMMAND
from multidrop.profile import PointDescription, Profile
from multidrop.tools.profiles.text import toml_text

MOST_WRONG = 0.05
BAUD = "9600"
LISTEN = "tcp://127.0.0.1:0"


@dataclass(frozen=True, slots=True)
class Sweep:
    """A discovery: of which device, as which profile it is asked, and where."""

    work: str
    there: str
    asked: str
    where: str


@dataclass(frozen=True, slots=True)
class Foretold:
    """What the command said of the places that were left, and what came. Times are in s."""

    places: int
    left: int
    found: int
    said: float
    took: float

    @property
    def wrong(self) -> float:
        return self.said / self.took - 1


@contextmanager
def simulated(device: str) -> Iterator[str]:
    """A device on a paced line in a process of its own, that answers at once; its port."""
    arguments = [COMMAND, "simulate", device, "--listen", LISTEN, "--pace", "--baud", BAUD]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    try:
        yield line_of(process.stdout).removeprefix("listening on ")
    finally:
        process.terminate()
        process.communicate()


def discovery(quick: bool) -> list[Result]:
    """The time that is said first, and the time that it takes, with each protocol."""
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "press.toml")
        Path(file).write_text(toml_text(press()))
        sweeps = [
            Sweep("indices of a FlexMax", "flexmax", "flexmax", "8000..9999"),
            Sweep("indices of a drive with many parameters", file, "flexmax", "8000..9999"),
            Sweep("parameters of an Ultra3000", "ultra3000", "ultra3000", "0x000..0x7CF"),
            Sweep("stretches of a 53MC5000's memory", "53mc5000", "53mc5000", "0x0000..0xF9FF"),
        ]
        rounds = 1 if quick else 2
        found = [[foretold(sweep, folder) for _ in range(rounds)] for sweep in sweeps]
    return [_row(sweep, runs) for sweep, runs in zip(sweeps, found, strict=True)]


def _row(sweep: Sweep, runs: list[Foretold]) -> Result:
    run = runs[0]
    worst = max((run.wrong for run in runs), key=abs)
    return Result(
        f"time that `multidrop discover` foretells for {run.places:,} {sweep.work}, paced {BAUD} baud",
        f"the time that it takes, {median(run.took for run in runs):.1f} s",
        f"within {MOST_WRONG:.0%}",
        f"{worst:+.1%}",
        abs(worst) <= MOST_WRONG,
        [
            f"{run.found} points found; of what is left after the first {run.places - run.left}: "
            + ", ".join(
                f"foretold {run.said:.1f} s, took {run.took:.1f} s ({run.wrong:+.1%})"
                for run in runs
            )
        ],
    )


def foretold(sweep: Sweep, folder: str) -> Foretold:
    """The whole command; its time is counted from when it has said how long it will take."""
    with simulated(f"{sweep.there}:0") as port:
        device = f"{sweep.asked}:0@{port},baud={BAUD},timeout=1"  # a simulator that stalls is there
        output = f"{folder}/found.toml"
        process = subprocess.Popen(
            [COMMAND, "discover", device, sweep.where, "-o", output, "--json", "--force"],
            stdout=subprocess.PIPE,
            text=True,
        )
        first = json.loads(line_of(process.stdout))
        started = monotonic()
        last = json.loads(line_of(process.stdout))
        took = monotonic() - started
        process.communicate()
    return Foretold(first["places"], first["left"], last["found"], first["seconds"], took)


def press() -> Profile:
    """A drive with parameters of all types, in clusters and alone."""
    types = ("int16", "uint16", "int32", "uint32", "float32")
    places = [*range(8000, 8040), *range(8236, 8260, 3), *range(8700, 8720), *range(9100, 9160, 2)]
    points = {
        f"p{at}": PointDescription(f"p{at}", f"{at}:{types[number % len(types)]}")
        for number, at in enumerate(places)
    }
    return Profile("press", "slink3", dialect="flexmax", points=points)
