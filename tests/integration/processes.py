"""multidrop in processes of its own: its command line, and simulated lines to talk to."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

COMMAND = str(Path(sys.executable).with_name("multidrop"))
DEVICES = ("flexmax:0+dgfc386", "flexmax:1", "ax-v:2")
"""Of the examples: two drives, one with a card behind it, and an AX-V."""

PATIENCE = 20.0
"""s after which something that should have happened long ago has not."""


def environment(**changes: str) -> dict[str, str]:
    """The test's own environment for a child: no colours, no pager, every warning an error."""
    plain = {"PYTHONWARNINGS": "error", "NO_COLOR": "1", "COLUMNS": "200", "PYTHONFAULTHANDLER": ""}
    return {**os.environ, **plain, **changes}


@dataclass(frozen=True)
class Ran:
    """A command that has ended: its exit status and what it printed."""

    status: int
    out: str
    err: str

    @property
    def objects(self) -> list[dict[str, Any]]:
        """Standard output as JSON Lines."""
        return [json.loads(line) for line in self.out.splitlines()]

    @property
    def object(self) -> dict[str, Any]:
        (only,) = self.objects
        return only


def multidrop(*arguments: str, cwd: Path | None = None, **changes: str) -> Ran:
    """Run the command to its end, without a terminal. A traceback fails the test."""
    done = subprocess.run(
        [COMMAND, *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        cwd=cwd,
        env=environment(**changes),
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return Ran(done.returncode, done.stdout, done.stderr)


class Running:
    """A program that goes on until it is told to end; what it prints can be awaited."""

    def __init__(self, *arguments: str, cwd: Path | None = None, **changes: str) -> None:
        self.process = subprocess.Popen(
            arguments,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=cwd,
            env=environment(**changes),
        )
        self.out: list[str] = []
        self.err: list[str] = []
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._readers = [
            threading.Thread(target=self._collect, args=pair, daemon=True)
            for pair in ((self.process.stdout, self.out), (self.process.stderr, self.err))
        ]
        for reader in self._readers:
            reader.start()

    def _collect(self, stream: IO[str], lines: list[str]) -> None:
        with stream:
            for line in stream:
                lines.append(line.rstrip("\n"))
                self._lines.put(lines[-1])
        self._lines.put(None)

    def wait_for(self, part: str) -> str:
        """The next line, of either stream, that `part` occurs in."""
        ends = 0
        while ends < 2:
            try:
                line = self._lines.get(timeout=PATIENCE)
            except queue.Empty:
                break
            if line is None:
                ends += 1
            elif part in line:
                return line
        raise AssertionError(f"{part!r} was never printed: {self.out[-5:]} {self.err[-5:]}")

    def prints(self, part: str) -> None:
        """Wait until a line with `part` was printed, before or after those that were waited for."""
        if not any(part in line for line in (*self.out, *self.err)):
            self.wait_for(part)

    def interrupt(self) -> Ran:
        """Ctrl-C."""
        return self.end(signal.SIGINT)

    def end(self, number: signal.Signals = signal.SIGKILL) -> Ran:
        """Send a signal, wait for the end, and return what was printed."""
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(number)
        return self.ended()

    def ended(self) -> Ran:
        """Wait for the end."""
        try:
            status = self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise AssertionError(f"it does not end: {self.out[-5:]} {self.err[-5:]}") from None
        for reader in self._readers:
            reader.join(PATIENCE)
        return Ran(status, "\n".join(self.out), "\n".join(self.err))


@contextlib.contextmanager
def running(*arguments: str, cwd: Path | None = None, **changes: str) -> Iterator[Running]:
    """A command that goes on; it is killed at the end of the test if it has not ended by itself."""
    program = Running(COMMAND, *arguments, cwd=cwd, **changes)
    try:
        yield program
    finally:
        program.end()


class Address:
    """Where a line listens."""

    def __init__(self, port: str) -> None:
        self.port = port

    def device(self, who: str, **keys: object) -> str:
        """`flexmax:0` as the command line names it, with keys."""
        return ",".join([f"{who}@{self.port}", *(f"{key}={value}" for key, value in keys.items())])


class Simulator(Address):
    """`multidrop simulate` in a process of its own."""

    def __init__(self, program: Running) -> None:
        self.program = program
        super().__init__(program.wait_for("listening on ").removeprefix("listening on "))


@contextlib.contextmanager
def simulator(
    *arguments: str, listen: str = "tcp://127.0.0.1:0", **changes: str
) -> Iterator[Simulator]:
    """Simulated devices; without arguments those of the examples."""
    devices = arguments or DEVICES
    arguments = ("simulate", *devices, "--listen", listen)
    with running(*arguments, cwd=None, **changes) as program:
        yield Simulator(program)
