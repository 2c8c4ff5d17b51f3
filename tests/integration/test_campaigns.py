"""The whole gateway, in a process of its own, while something goes wrong: what history has afterwards.

MULTIDROP_SOAK=1 for the long ones, MULTIDROP_SEED for other moments.
"""

from __future__ import annotations

import random
import signal
import sys
import time
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from postgres import own_database

from integration import stepping_clock
from integration.counting import (
    SEED,
    SOAK,
    CountingLine,
    all_is_kept,
    lost_of,
    plant,
    recorded,
    stop,
)
from integration.processes import Running, multidrop, running
from integration.proxy import proxy_to

LAST = 1.0
"""s before a kill -9 of which samples may be lost: history is written twice in them."""

KILLED = "the gateway ended without being stopped"


# -- killed ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("database", "kills"), [("sqlite", 20 if SOAK else 2), ("postgres", 20 if SOAK else 1)]
)
def test_killed_at_any_moment(tmp_path: Path, database: str, kills: int) -> None:
    """What is missing is of the last second before a kill, and inside a gap that is marked."""
    moments = random.Random(SEED)
    killed: list[tuple[float, float]] = []
    with ExitStack() as stack:
        history = "[history]\n"
        if database == "postgres":
            history += f'dsn = "{stack.enter_context(own_database())}"\n'
        line = CountingLine("press")
        stack.enter_context(
            plant(tmp_path, f"{history}[faults]\n[modbus]\nlisten = '127.0.0.1:0'\n", line)
        )
        for _ in range(kills):
            with running("run", cwd=tmp_path) as program:
                line.wait_for_more()
                time.sleep(moments.uniform(0.0, 1.5))
                program.end(signal.SIGKILL)
                killed.append((time.time(), time.monotonic()))
        with running("run", cwd=tmp_path) as program:
            line.wait_for_more(20)
            stop(program)
        assert multidrop("check", cwd=tmp_path).status == 0
        found = recorded(tmp_path, line)
    ages = []
    lost = lost_of(line, found)
    for one in lost:
        if one.number == len(line.given):
            continue  # the answer that came as the gateway stopped
        marked = any(gap.start <= one.wall <= gap.end for gap in found.gaps)
        assert marked or one.number < found.numbers[0], (SEED, one)  # or history had not begun
        ages.append(min(at - one.monotonic for _, at in killed if at >= one.monotonic))
    print(
        f"{database}: {kills} kills, {len(line.given)} given, {len(lost)} lost, ages {max(ages, default=0):.3f}"
    )
    assert max(ages, default=0.0) <= LAST, SEED
    assert [gap.reason for gap in found.gaps] == [KILLED] * len(found.gaps)
    for wall, _ in killed:
        if wall > found.kept[0].wall:
            assert any(gap.start <= wall <= gap.end for gap in found.gaps)
    for gap in found.gaps:
        assert not any(gap.start < sample.wall < gap.end for sample in found.kept)


# -- the clock -------------------------------------------------------------------------------------


def test_a_clock_that_steps_back_and_forth(tmp_path: Path) -> None:
    """An hour back, then two forward: every sample in the order in which it happened."""
    line = CountingLine("press")
    wrong = tmp_path / "wrong_by"
    with plant(tmp_path, "[history]\n", line):
        program = Running(sys.executable, stepping_clock.__file__, str(wrong), "run", cwd=tmp_path)
        try:
            line.wait_for_more(25)
            for step in (-3600, 3600):
                wrong.write_text(str(step))
                program.process.send_signal(signal.SIGUSR1)
                line.wait_for_more(60 if SOAK else 25)
            stop(program)
        finally:
            program.end()
        found = recorded(tmp_path, line)
        all_is_kept(tmp_path, [line])
    given = {one.number: one for one in line.given}
    offsets = [round((sample.wall - given[sample.number].wall) / 3600) for sample in found.kept]
    changes = [offsets[0]] + [b for a, b in pairwise(offsets) if a != b]
    assert changes == [0, -1, 1]
    monotonic = [sample.monotonic for sample in found.kept]
    assert monotonic == sorted(monotonic)


# -- the port ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_a_port_that_goes_and_comes(tmp_path: Path, kind: str) -> None:
    """At most the answer that was on its way is missing; that the port was lost is marked."""
    times = 20 if SOAK else 1
    moments = random.Random(SEED)
    with ExitStack() as stack:
        if kind == "pty":
            line = CountingLine("press", f"pty:{tmp_path / 'adapter'}")
            unplug, plug_in = line.unplug, line.plug_in
            stack.enter_context(plant(tmp_path, "[history]\n", line))
        else:
            line = CountingLine("press")
            split = urlsplit(line.port)
            assert split.hostname is not None
            assert split.port is not None
            proxy = stack.enter_context(proxy_to(split.hostname, split.port))
            unplug, plug_in = proxy.cut, proxy.join
            there, line.port = line.port, f"tcp://127.0.0.1:{proxy.port}"
            stack.enter_context(plant(tmp_path, "[history]\n", line))
            line.port = there
        unplugged: list[tuple[float, range]] = []
        program = stack.enter_context(running("run", cwd=tmp_path))
        for _ in range(times):
            line.wait_for_more(10)
            time.sleep(moments.uniform(0.0, 0.3))
            wall, before = time.time(), len(line.given)
            unplug()
            program.wait_for("port lost")
            time.sleep(moments.uniform(0.2, 0.7))  # what was on its way has arrived, or never will
            unplugged.append((wall, range(before, len(line.given) + 1)))
            plug_in()
            program.wait_for("port open again")
        line.wait_for_more(10)
        stop(program)
        found = recorded(tmp_path, line)
        lost = {one.number for one in lost_of(line, found)}
    lost.discard(len(line.given))
    for _, numbers in unplugged:
        assert len(lost.intersection(numbers)) <= 1  # the answer that was on its way
        lost -= set(numbers)
    assert not lost, SEED
    assert found.gaps == []
    assert {quality for _, quality in found.marks} == {"port lost"}
    for wall, numbers in unplugged:
        mark = min(start for start, _ in found.marks if start >= wall)
        assert mark < min(sample.wall for sample in found.kept if sample.number > numbers[-1])
