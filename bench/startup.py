"""`multidrop read` of one point over TCP, as a whole process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from statistics import median
from time import perf_counter

from bench.measure import Result, interleaved, line_of, ratio

COMMAND = str(Path(sys.executable).with_name("multidrop"))


def startup(quick: bool) -> list[Result]:
    with subprocess.Popen(
        [COMMAND, "simulate", "flexmax:0", "--listen", "tcp://127.0.0.1:0"],
        stdout=subprocess.PIPE,
        text=True,
    ) as simulator:
        try:
            port = line_of(simulator.stdout).split()[-1]
            read = [COMMAND, "read", f"flexmax:0@{port}", "8236:int16"]
            bare = [sys.executable, "-c", "import asyncio"]
            nothing = [sys.executable, "-c", ""]
            _seconds(read)  # compiles what was not compiled yet
            found = interleaved(
                5 if quick else 30,
                {
                    "read": lambda: _seconds(read),
                    "asyncio": lambda: _seconds(bare),
                    "python": lambda: _seconds(nothing),
                },
            )
        finally:
            simulator.kill()
    times = ratio(found["read"], found["asyncio"])
    return [
        Result(
            "`multidrop read` of one point over TCP, whole process",
            '`python -c "import asyncio"`',
            "<= 2.5",
            f"{times:.2f}",
            times <= 2.5,
            [
                f"multidrop read {_ms(found['read'])}, import asyncio {_ms(found['asyncio'])}, "
                f"Python alone {_ms(found['python'])}"
            ],
        )
    ]


def _seconds(command: list[str]) -> float:
    started = perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - started


def _ms(seconds: list[float]) -> str:
    return f"{median(seconds) * 1000:.0f} ms"
