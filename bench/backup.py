"""Backups and discoveries on paced lines: how near to the line's limit, and how well foretold."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import monotonic

from bench.measure import Result, line_of
from bench.scan import COMMAND
from multidrop.io.connection import connect
from multidrop.passports.backup import Backup
from multidrop.profile import PointDescription, Profile
from multidrop.tools.profiles.discover import Discovery, Meter
from multidrop.tools.profiles.text import toml_text

BACKUPS = ("53mc5000", "ultra3000")
LEAST_SHARE = 0.97
INDICES = "8000..9999"
MOST_WRONG = 0.05
LISTEN = "tcp://127.0.0.1:0"


@contextmanager
def simulated(device: str) -> Iterator[str]:
    """A device on a paced line in a process of its own, that answers at once; its port."""
    arguments = [COMMAND, "simulate", device, "--listen", LISTEN, "--pace", "--delay", "0"]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    try:
        yield line_of(process.stdout).removeprefix("listening on ")
    finally:
        process.terminate()
        process.communicate()


def backups(quick: bool) -> list[Result]:
    """A backup of all readable points."""
    return [_backup_row(profile, 1 if quick else 5) for profile in BACKUPS]


def _backup_row(profile: str, rounds: int) -> Result:
    shares, took, limits = [], [], []
    with simulated(f"{profile}:0") as port:
        for _ in range(rounds):
            with connect(f"{profile}:0@{port},timeout=1") as connection:
                settings = connection.target.settings
                meter = Meter(settings.character)
                connection.line.taps.append(meter)
                run = Backup.of(connection)
                started = monotonic()
                for _ in run.run():
                    pass
                took.append(monotonic() - started)
            limits.append(meter.characters * settings.character + meter.messages * settings.gap)
            shares.append(limits[-1] / took[-1])
    points, messages = len(run.points), meter.messages
    return Result(
        f"backup of a {profile}, all its {points} readable points, paced {settings.baud} {settings.format}",
        f"the line's limit, {median(limits):.2f} s: characters and gaps",
        f">= {LEAST_SHARE:g} of it",
        f"{median(shares):.3f}",
        median(shares) >= LEAST_SHARE,
        [
            f"{median(took):.2f} s, {messages} messages, {points / messages:.1f} points and "
            f"{meter.characters / messages:.1f} characters each, both ways",
        ],
    )


def discovery(quick: bool) -> list[Result]:
    """The time that `multidrop discover` says first, and the time that it takes."""
    rounds = 1 if quick else 3
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "press.toml"
        path.write_text(toml_text(_press()))
        few = [_foretold("flexmax") for _ in range(rounds)]
        many = [_foretold(str(path)) for _ in range(rounds)]
    worst = max((said / took - 1 for said, took in few), key=abs)
    beside = []
    for name, found in (("a few parameters", few), ("a hundred in clusters", many)):
        said, took = (median(column) for column in zip(*found, strict=True))
        beside.append(
            f"with {name}: foretold {said:.1f} s, took {took:.1f} s, {said / took - 1:+.1%}"
        )
    return [
        Result(
            "time that `multidrop discover` foretells for 2,000 indices of a FlexMax, paced 9600 8E1",
            "the time that it takes",
            f"within {MOST_WRONG:.0%}",
            f"{worst:+.1%}",
            abs(worst) <= MOST_WRONG,
            [
                *beside,
                "of that what is left after the first 250; how many parameters it has"
                " is guessed from these",
            ],
        )
    ]


def _foretold(profile: str) -> tuple[float, float]:
    """s that were foretold, and s that it took."""
    with simulated(f"{profile}:0") as port, connect(f"flexmax:0@{port},timeout=1") as connection:
        run = Discovery(connection, INDICES)
        said = run.estimate()
        started = monotonic()
        for _ in run.run():
            pass
        return said, monotonic() - started


def _press() -> Profile:
    """A drive with parameters of all types, in clusters and alone."""
    types = ("int16", "uint16", "int32", "uint32", "float32")
    places = [*range(8000, 8040), *range(8236, 8260, 3), *range(8700, 8720), *range(9100, 9160, 2)]
    points = {
        f"p{at}": PointDescription(f"p{at}", f"{at}:{types[number % len(types)]}")
        for number, at in enumerate(places)
    }
    return Profile("press", "slink3", dialect="flexmax", points=points)


def rows(quick: bool) -> list[Result]:
    return [*backups(quick), *discovery(quick)]
