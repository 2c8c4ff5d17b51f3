"""A command on a terminal of its own: what it shows can be awaited, and what it asks answered."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import select
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from integration.processes import COMMAND, PATIENCE, environment

CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\r")


class Terminal:
    """Standard input, output and error of one command are a terminal."""

    def __init__(self, *arguments: str, cwd: Path | None = None, **changes: str) -> None:
        self._fd, other = pty.openpty()
        self.process = subprocess.Popen(
            [COMMAND, *arguments],
            stdin=other,
            stdout=other,
            stderr=other,
            cwd=cwd,
            env=environment(
                **{"TERM": "xterm", "NO_COLOR": "", "COLUMNS": "120", "LINES": "40", **changes}
            ),
            start_new_session=True,
        )
        os.close(other)
        self.shown = ""  # without colours and cursor moves
        self.raw = b""

    def wait_for(self, part: str) -> str:
        """All that was shown, once `part` is in what is new; colours and cursor moves are taken out."""
        until = time.monotonic() + PATIENCE
        new = ""
        while part not in new and time.monotonic() < until:
            data = self._read(until - time.monotonic())
            if not data:
                break
            new = CONTROL.sub("", new + data.decode("utf-8", "replace"))
        self.shown += new
        assert part in new, f"{part!r} was never shown: {new[-500:]!r}"
        return self.shown

    def _read(self, seconds: float) -> bytes:
        ready, _, _ = select.select([self._fd], [], [], seconds)
        if not ready:
            return b""
        data = b""
        with contextlib.suppress(OSError):  # the command has ended
            data = os.read(self._fd, 4096)
        self.raw += data
        return data

    def type(self, text: str) -> None:
        os.write(self._fd, text.encode())

    def interrupt(self) -> int:
        """Ctrl-C, once the command waits: Python loses one that comes just before."""
        self._await_sleep()
        self.process.send_signal(signal.SIGINT)
        return self.ended()

    def _await_sleep(self) -> None:
        """Wait until the command has been waiting for something for a while."""
        state = Path(f"/proc/{self.process.pid}/stat")
        asleep = 0
        until = time.monotonic() + PATIENCE
        while asleep < 5 and state.exists() and time.monotonic() < until:
            asleep = asleep + 1 if state.read_text().rpartition(")")[2].split()[0] == "S" else 0
            time.sleep(0.01)

    def ended(self) -> int:
        """The exit status; what was shown until the end is kept."""
        until = time.monotonic() + PATIENCE
        while data := self._read(max(0.0, until - time.monotonic())):
            self.shown = CONTROL.sub("", self.shown + data.decode("utf-8", "replace"))
        return self.process.wait(PATIENCE)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._fd)


@contextlib.contextmanager
def on_terminal(*arguments: str, cwd: Path | None = None, **changes: str) -> Iterator[Terminal]:
    terminal = Terminal(*arguments, cwd=cwd, **changes)
    try:
        yield terminal
    finally:
        terminal.close()
