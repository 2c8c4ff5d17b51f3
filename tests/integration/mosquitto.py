"""A real Mosquitto of the test's own. Without it a test is skipped."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from programs import program

from integration.processes import PATIENCE


def found(name: str) -> str:
    """Where one of its programs is."""
    return program(name, "make mosquitto")


class Broker:
    """It can be killed and started again on the same port; it forgets everything then."""

    def __init__(self, folder: Path, *settings: str) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port: int = free.getsockname()[1]
        self._file = folder / "mosquitto.conf"
        self._log = folder / "mosquitto.log"
        lines = [f"listener {self.port} 127.0.0.1", *(settings or ["allow_anonymous true"])]
        self._file.write_text("\n".join([*lines, "user root", ""]))
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        """Returns when it takes connections."""
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [found("mosquitto"), "-v", "-c", str(self._file)], stdout=log, stderr=log
            )
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port)):
                return
            assert self._process.poll() is None, self._log.read_text()
            time.sleep(0.02)
        raise AssertionError("mosquitto does not listen")

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait(PATIENCE)
            self._process = None


@contextlib.contextmanager
def broker(folder: Path, *settings: str) -> Iterator[Broker]:
    """A broker with these lines of its configuration, else one that lets everybody in."""
    made = Broker(folder, *settings)
    try:
        yield made
    finally:
        made.kill()
