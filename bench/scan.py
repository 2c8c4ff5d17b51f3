"""A scan of a paced line: all 128 addresses of SLINK3 at one setting, three devices present."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import monotonic

from bench.measure import Result, line_of

COMMAND = str(Path(sys.executable).with_name("multidrop"))
DEVICES = ("flexmax:0+dgfc386", "ax-v:2", "dgfc386:77")
FOUND = ["flexmax:0", "ax-v:2", "dgfc386:77"]
KINDS = {"TCP": "tcp://127.0.0.1:0", "pty": "pty"}
DELAY = 20  # ms that a device takes to answer
GOAL = 20.0  # s


@contextmanager
def simulated(listen: str) -> Iterator[str]:
    """The devices on a paced line in a process of its own; its port."""
    arguments = [COMMAND, "simulate", *DEVICES, "--listen", listen, "--pace", "--delay", str(DELAY)]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    try:
        yield line_of(process.stdout).removeprefix("listening on ")
    finally:
        process.terminate()
        process.communicate()


def scanned(listen: str) -> float:
    """s that the whole command takes, from its start to its end. Raises `RuntimeError`."""
    with simulated(listen) as port, tempfile.TemporaryDirectory() as state:
        started = monotonic()
        done = subprocess.run(
            [COMMAND, "scan", port, "--protocol", "slink3", "--json"],
            capture_output=True,
            text=True,
            env={**os.environ, "XDG_STATE_HOME": state},
            check=True,
        )
        took = monotonic() - started
    found = [json.loads(line) for line in done.stdout.splitlines()]
    names = [f"{item['profile']}:{item['address']}" for item in found]
    if names != FOUND:
        raise RuntimeError(f"{names} were found, not {FOUND}")
    return took


def scan(quick: bool) -> list[Result]:
    rounds = 1 if quick else 5
    return [
        _result(kind, [scanned(listen) for _ in range(rounds)]) for kind, listen in KINDS.items()
    ]


def _result(kind: str, took: list[float]) -> Result:
    return Result(
        f"`multidrop scan` of 128 addresses at one setting of a paced 9600-baud line, 3 devices, {kind}",
        "1.5 s for each address: 192 s",
        f"< {GOAL:g} s",
        f"{median(took):.1f} s",
        median(took) < GOAL,
        [
            f"slowest {max(took):.1f} s; 2 s of listening, 128 x (8 characters + 80 ms), 1.5 s of "
            "listening, and the reads that tell the three models apart"
        ],
    )
