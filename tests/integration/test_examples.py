"""Every example runs, and every command that the README prints does what it says."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from integration.processes import (
    COMMAND,
    DEVICES,
    PATIENCE,
    Address,
    Running,
    environment,
    multidrop,
)

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
README = (ROOT / "README.md").read_text(encoding="utf-8")
PRINTED = "tcp://127.0.0.1:4001"
GOES_ON = {"simulate", "watch", "demo"}
"""Commands that end with Ctrl-C alone."""


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 4


def test_they_run_against_what_the_readme_starts() -> None:
    """`fresh` simulates the same devices."""
    (started,) = re.findall(r"^multidrop simulate (.*) --listen", README, re.MULTILINE)
    assert started.split() == list(DEVICES)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.name)
def test_an_example_runs(example: Path, fresh: Address, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(example)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        cwd=tmp_path,
        env=environment(MULTIDROP_EXAMPLE_PORT=fresh.port),
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout


def test_the_example_of_a_slave_serves_until_ctrl_c() -> None:
    example = str(ROOT / "examples" / "slave.py")
    server = Running(sys.executable, example, "tcp://127.0.0.1:0", PYTHONUNBUFFERED="1")
    try:
        port = server.wait_for("listening on ").removeprefix("listening on ")
        ran = multidrop("write", f"ax-v:5@{port}", "101:int16=700", "--json")
        assert ran.object["outcome"] == "confirmed"
        assert multidrop("read", f"ax-v:5@{port}", "100:int16").status == 0
    finally:
        server.end(signal.SIGINT)


# -- the README --------------------------------------------------------------------------------


def printed(text: str) -> list[str]:
    """The commands of multidrop in the fenced blocks of a page."""
    found = []
    for kind, body in re.findall(r"^```(sh|console)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        for line in body.splitlines():
            command = line.removeprefix("$ ") if kind == "console" else line
            if command.startswith("multidrop ") and (kind == "sh" or line != command):
                found.append(command.partition("  #")[0].strip())
    return found


def goes_on(command: str) -> bool:
    words = shlex.split(command)
    return words[1] in GOES_ON or "--every" in words


@contextlib.contextmanager
def started(command: str, directory: Path) -> Iterator[Running]:
    _, *words = shlex.split(command)
    program = Running(COMMAND, *words, cwd=directory)
    try:
        yield program
    finally:
        program.end(signal.SIGINT)


@pytest.fixture
def port() -> str:
    """The port that the README prints, if nobody has it; else a free one."""
    for number in (4001, 0):
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", number)) as bound:
            return f"tcp://127.0.0.1:{bound.getsockname()[1]}"
    raise AssertionError("no port is free")


def test_the_commands_of_the_readme(port: str, tmp_path: Path) -> None:
    commands = [command.replace(PRINTED, port) for command in printed(README)]
    assert commands[0].startswith("multidrop simulate ")
    path = f"{Path(COMMAND).parent}{os.pathsep}{os.environ['PATH']}"
    with contextlib.ExitStack() as stack:
        for command in commands:
            if goes_on(command):
                listens = shlex.split(command)[1] in ("simulate", "demo")
                program = stack.enter_context(started(command, tmp_path))
                program.wait_for("listening on " if listens else "")
                continue
            done = subprocess.run(
                ["bash", "-c", command],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                timeout=PATIENCE,
                cwd=tmp_path,
                env=environment(PATH=path),
                check=False,
            )
            assert done.returncode == 0, (command, done.stderr)
            assert done.stdout
    assert len(commands) > 4


def test_the_readme_shows_what_comes() -> None:
    """Its commands, programs and their output, as docs/outputs.py compares them."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "outputs.py"), "--check", "README.md"],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=ROOT,
        check=False,
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
