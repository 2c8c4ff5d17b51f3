"""Drives that count their own answers: what a gateway must have recorded is known without asking it.

Every answer to a read of `count` is the next number, so a lost sample is a missing number, a doubled
one comes twice, and one out of order is smaller than the one before.
"""

from __future__ import annotations

import asyncio
import contextlib
import csv
import os
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from integration.processes import PATIENCE, Running, multidrop
from multidrop.io.listen import Listener
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Format
from multidrop.sim.line import SimulatedLine
from multidrop.sim.serve import serve
from multidrop.sim.slink3 import FlexMax, Parameter

SOAK = bool(os.environ.get("MULTIDROP_SOAK"))
SEED = int(os.environ.get("MULTIDROP_SEED", "7"))

COUNT = 8300
PLANT = """
[line.{line}]
port = "{port}"
baud = 115200
timeout = 2
[line.{line}.device.{line}]
profile = "flexmax"
address = 0
[line.{line}.device.{line}.points]
count = {{ at = "8300:int32", every = 0.05 }}
feed = {{ at = "8236:int16", every = 0.5, write = {{ min = 0, max = 1500 }} }}
"""


class Given(NamedTuple):
    """A number that a drive gave, and when it did: wall time and monotonic time of this machine, s."""

    number: int
    wall: float
    monotonic: float


class CountingLine:
    """One such drive on a line of its own, served by a thread; it can be unplugged."""

    def __init__(self, name: str, port: str = "tcp://127.0.0.1:0") -> None:
        self.name = name
        self.port = port
        self.drive = FlexMax(0)
        self.given: list[Given] = []
        self.drive.parameters.known[COUNT, 0] = Parameter(Format.LONG_INT, get=self._next)
        self._line = SimulatedLine([self.drive], slink3.decoder)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._listener: Listener | None = None
        self.plug_in()

    def _next(self, now: float) -> int:
        self.given.append(Given(len(self.given) + 1, time.time(), time.monotonic()))
        return len(self.given)

    @property
    def toml(self) -> str:
        return PLANT.format(line=self.name, port=self.port.removeprefix("pty:"))

    def plug_in(self) -> None:
        serving = asyncio.run_coroutine_threadsafe(serve(self._line, self.port), self._loop)
        self._listener = serving.result(PATIENCE)
        if self.port.startswith("tcp:"):
            self.port = self._listener.port

    def unplug(self) -> None:
        async def close() -> None:
            assert self._listener is not None
            self._listener.close()

        asyncio.run_coroutine_threadsafe(close(), self._loop).result(PATIENCE)

    def close(self) -> None:
        self.unplug()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)
        self._loop.close()

    def wait_for_more(self, count: int = 5) -> None:
        """Until it was asked so many times more: a gateway is polling."""
        enough = len(self.given) + count
        wait_until(lambda: len(self.given) >= enough)


@contextlib.contextmanager
def counting(*lines: CountingLine) -> Iterator[None]:
    try:
        yield
    finally:
        for line in lines:
            line.close()


@contextlib.contextmanager
def plant(folder: Path, tables: str, *lines: CountingLine) -> Iterator[None]:
    """A plant file of these lines, and of `tables` beside them."""
    text = "".join(line.toml for line in lines) + tables
    (folder / "multidrop.toml").write_text(text, encoding="utf-8")
    with counting(*lines):
        yield


def wait_until(happened: object, patience: float = PATIENCE) -> None:
    until = time.monotonic() + patience
    while not happened():  # type: ignore[operator]
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.01)


# -- what was recorded ------------------------------------------------------------------------------


class Kept(NamedTuple):
    number: int
    wall: float
    monotonic: float


class Gap(NamedTuple):
    start: float
    end: float
    reason: str


@dataclass
class Recorded:
    """What an export of history has of a drive's `count`."""

    kept: list[Kept] = field(default_factory=list)
    marks: list[tuple[float, str]] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)

    @property
    def numbers(self) -> list[int]:
        return [sample.number for sample in self.kept]


def seconds(text: str) -> float:
    return datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()


def recorded(folder: Path, line: CountingLine) -> Recorded:
    """By `multidrop history export`, in a process of its own."""
    done = multidrop("history", "export", line.name, "count", cwd=folder)
    assert done.status == 0, done.err
    found = Recorded()
    for row in csv.DictReader(StringIO(done.out)):
        start, quality = seconds(row["time"]), row["quality"]
        if quality.startswith("gap until "):
            end, _, reason = quality.removeprefix("gap until ").partition(": ")
            found.gaps.append(Gap(start, seconds(end), reason))
        elif quality == "good":
            found.kept.append(Kept(int(row["value"]), start, float(row["monotonic"])))
        else:
            found.marks.append((start, quality))
    return found


def lost_of(line: CountingLine, found: Recorded) -> list[Given]:
    """What a drive gave and history has not. What it has is in order, once, and of its time."""
    numbers = found.numbers
    assert numbers, "nothing was recorded"
    wrong = [pair for pair in pairwise(numbers) if pair[0] >= pair[1]]
    assert not wrong, f"out of order, or twice: {wrong}"
    given = {one.number: one for one in line.given}
    for sample in found.kept:
        assert sample.number in given, f"{sample} was never given"
        late = sample.monotonic - given[sample.number].monotonic
        assert abs(late) < 1.0, f"{sample} is {late} s away from when it was given"
    return [one for number, one in given.items() if number not in set(numbers)]


def stop(program: Running) -> None:
    """A clean stop: what came last is recorded too."""
    import signal

    done = program.end(signal.SIGTERM)
    assert done.status == 0, done.err
    assert "Traceback" not in done.err, done.err


def all_is_kept(folder: Path, lines: Sequence[CountingLine]) -> None:
    """Everything that every drive gave, and no gap. One answer may have come as the gateway stopped."""
    for line in lines:
        found = recorded(folder, line)
        lost = lost_of(line, found)
        assert [one.number for one in lost] in ([], [len(line.given)]), f"lost: {lost}"
        assert found.gaps == [], f"gaps: {found.gaps}"
