"""Backups on paced lines: how near to the line's limit."""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import monotonic

from bench.discovery import discovery, press
from bench.measure import Result
from bench.paced import StampedPort, simulated
from bench.scan import COMMAND
from multidrop.catalog import load_profile
from multidrop.io.connection import Connection, Target
from multidrop.io.line import Line
from multidrop.io.ports import open_port
from multidrop.naming import parse_device
from multidrop.passports.backup import Backup
from multidrop.timing import LineSettings
from multidrop.tools.profiles.text import toml_text

LEAST_SHARE = 0.97


@dataclass(frozen=True, slots=True)
class Run:
    """One backup of all points. Times are in s."""

    settings: LineSettings
    points: int
    messages: int
    characters: int  # both ways
    took: float  # from the first request to the last answer
    late: (
        float  # of that the simulator's: it had a request, or sent an answer, later than it should
    )
    own: float  # from an answer's last byte to the next request, without the gap: the median

    @property
    def limit(self) -> float:
        """The characters of all messages, and the gaps between them."""
        gaps = (self.messages - 1) * self.settings.gap
        return self.characters * self.settings.character + gaps

    @property
    def share(self) -> float:
        """Of the line's limit, were the simulator never late."""
        return self.limit / (self.took - self.late)

    @property
    def with_simulator(self) -> float:
        return self.limit / self.took


def backups(quick: bool) -> list[Result]:
    """A backup of all readable points, of each protocol."""
    rounds = 1 if quick else 5
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "press.toml"
        file.write_text(toml_text(press()))
        return [
            _row(profile, [_backed_up(profile) for _ in range(rounds)], _command(profile, folder))
            for profile in (str(file), "53mc5000", "ultra3000")
        ]


def _row(profile: str, runs: list[Run], command: float) -> Result:
    run = runs[0]
    name, line = Path(profile).stem, run.settings
    share = median(run.share for run in runs)
    late = median(run.late / run.messages for run in runs) * 1000
    return Result(
        f"backup of all {run.points} readable points of {name}, paced {line.baud} {line.format}",
        f"the line's limit, {run.limit:.2f} s: characters and gaps",
        f">= {LEAST_SHARE:g} of it",
        f"{share:.3f}",
        share >= LEAST_SHARE,
        [
            f"{median(run.took for run in runs):.2f} s, {run.messages} messages, "
            f"{run.points / run.messages:.1f} points and "
            f"{run.characters / run.messages:.1f} characters each, both ways",
            f"with the {late:.2f} ms that the simulator is late in each message: "
            f"{median(run.with_simulator for run in runs):.3f}",
            f"from an answer to the next request, beyond the gap: "
            f"{median(run.own for run in runs) * 1000:.2f} ms median",
            f"the whole command, from its start to its end: {command:.2f} s",
        ],
    )


def _backed_up(profile: str) -> Run:
    with simulated("TCP", 0.0, profile) as (where, noted):
        name = f"{Path(profile).stem}:0@{where},timeout=1"  # a simulator that stalls is no silent device
        target = Target(parse_device(name), load_profile(profile))
        port = StampedPort(open_port(target.port, target.setup()))
        line = Line(port, target.settings, target.options)
        sizes: list[int] = []
        line.taps.append(lambda data, *_: sizes.append(len(data)))
        with Connection(target, target.device(), line) as connection:
            run = Backup.of(connection)
            started = monotonic()
            for _ in run.run():
                pass
            took = monotonic() - started
    assert len(noted) == len(port.sent), "a read was repeated"
    characters = sum(sizes)
    outs = [out for _, out in noted]
    at_simulator = sum(out - sent for sent, out in zip(port.sent, outs, strict=True))
    between = [sent - out for sent, out in zip(port.sent[1:], outs, strict=False)]
    return Run(
        target.settings,
        points=len(run.points),
        messages=len(noted),
        characters=characters,
        took=took,
        late=at_simulator - characters * target.settings.character,
        own=median(between) - target.settings.gap,
    )


def _command(profile: str, folder: str) -> float:
    """s that `multidrop backup` takes."""
    with simulated("TCP", 0.0, profile) as (where, _):
        device = f"{Path(profile).stem}:0@{where},timeout=1"
        arguments = [COMMAND, "backup", device, "-o", f"{folder}/a.passport.toml", "--force"]
        if profile.endswith(".toml"):
            arguments += ["--profile", profile]
        started = monotonic()
        subprocess.run(arguments, check=True, stdout=subprocess.DEVNULL)
        return monotonic() - started


def rows(quick: bool) -> list[Result]:
    return [*backups(quick), *discovery(quick)]
