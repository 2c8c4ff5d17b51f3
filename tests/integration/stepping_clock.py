"""multidrop on a machine whose wall clock is stepped: `python stepping_clock.py FILE ARGUMENT...`.

FILE has the seconds by which its wall clock is wrong; SIGUSR1 reads it again. Everything in the
process sees the same clock; monotonic time is left alone, as a real step leaves it.
"""

from __future__ import annotations

import datetime
import signal
import sys
import time
from pathlib import Path
from types import FrameType

real_time, real_time_ns = time.time, time.time_ns
wrong_by = [0.0]


class Stepped(datetime.datetime):
    @classmethod
    def now(cls, tz: datetime.tzinfo | None = None) -> Stepped:
        return cls.fromtimestamp(real_time() + wrong_by[0], tz)


def main(file: Path) -> None:
    def step(number: int, frame: FrameType | None) -> None:
        wrong_by[0] = float(file.read_text())

    signal.signal(signal.SIGUSR1, step)
    time.time = lambda: real_time() + wrong_by[0]
    time.time_ns = lambda: real_time_ns() + round(wrong_by[0] * 1e9)
    datetime.datetime = Stepped  # type: ignore[misc]
    from multidrop import cli

    cli.main()


if __name__ == "__main__":
    _, where, *arguments = sys.argv
    sys.argv = ["multidrop", *arguments]
    main(Path(where))
