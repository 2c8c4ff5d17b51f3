"""A capture of a line that was busy for a day, decoded to JSON Lines."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from itertools import cycle
from pathlib import Path

from bench.measure import Result
from multidrop.io import pcapng
from multidrop.io.capture import CaptureWriter, Known
from multidrop.protocols import PROTOCOLS, slink3

DAY = 86_400  # s
QUICK = DAY // 6
GOAL = 60.0  # s, on two cores
STARTING = 1.0  # s of it that do not get less with a shorter capture
NOON = 1_700_000_000 * 10**9
DEVICES = 4
POINTS = (8236, 8237, 8238, 8511, 1009)
VALUES = 60
ANSWER_AFTER, GAP = 0.0008, 0.0002  # s: hardly any, so that the line is full


def busy_line(path: Path, seconds: int) -> tuple[int, int]:
    """Reads one behind the other for so long at 9600 8E1; returns frames, and bytes on the wire."""
    line = slink3.LINE
    writer = CaptureWriter.create(path)
    writer.add_line(
        PROTOCOLS["slink3"],
        line,
        "/dev/ttyUSB0",
        [Known(address, "flexmax", f"drive{address}") for address in range(DEVICES)],
    )
    writer.close()
    frames = size = 0
    now = NOON
    end = NOON + seconds * 10**9
    with path.open("ab", buffering=1 << 20) as file:
        talk = cycle(_talk())
        while now < end:
            question, answer = next(talk)
            now += round((GAP + len(question) * line.character) * 1e9)
            file.write(pcapng.packet(0, now, question, 0))
            now += round((ANSWER_AFTER + len(answer) * line.character) * 1e9)
            file.write(pcapng.packet(0, now, answer, 0))
            frames += 2
            size += len(question) + len(answer)
    return frames, size


def _talk() -> list[tuple[bytes, bytes]]:
    pairs = []
    for number in range(DEVICES * len(POINTS) * VALUES):
        address, index = number % DEVICES, POINTS[number // DEVICES % len(POINTS)]
        where = bytes((3, index & 0xFF, index >> 8))
        question = slink3.Frame(address, 0, 0, 0x26, where).numbered(number // DEVICES)
        value = (number * 37 % 3000).to_bytes(2, "little")
        answer = slink3.Frame(address, question.control, 1, 0, where + value)
        pairs.append((question.encode(), answer.encode()))
    return pairs


def decoding_captures(quick: bool) -> list[Result]:
    seconds = QUICK if quick else DAY
    with tempfile.TemporaryDirectory() as directory:
        path, out = Path(directory) / "day.pcapng", Path(directory) / "day.jsonl"
        frames, size = busy_line(path, seconds)
        took, processor, memory = _decode(path, out)
        with out.open("rb") as file:
            lines = sum(1 for _ in file)
        file_size = path.stat().st_size
    assert lines == frames // 2, f"{lines} lines of {frames} frames"
    goal = STARTING + (GOAL - STARTING) * seconds / DAY
    return [
        Result(
            f"`multidrop decode --json` of {seconds / 3600:.0f} h of a full 9600-baud line, "
            f"{frames:,} frames, {size / 1e6:.0f} MB on the wire",
            "",
            f"< {goal:.0f} s",
            f"{took:.1f} s",
            took < goal,
            [
                f"{processor:.1f} s of processor time in all processes, "
                f"{processor / frames * 1e6:.1f} µs a frame",
                f"the file has {file_size / 1e6:.0f} MB; the largest process {memory / 1024:.0f} MB",
            ],
        )
    ]


def _decode(path: Path, out: Path) -> tuple[float, float, float]:
    """Seconds, seconds of processor time, and kB of the largest process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.monotonic()
    with out.open("wb") as file:
        subprocess.run(
            [Path(sys.executable).with_name("multidrop"), "decode", str(path), "--json"],
            stdout=file,
            stderr=subprocess.DEVNULL,
            check=True,
            env=os.environ,
        )
    took = time.monotonic() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return took, processor, after.ru_maxrss
