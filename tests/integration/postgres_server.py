"""A PostgreSQL of the test's own, that can be killed and started again."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from programs import program

from integration.processes import PATIENCE

SETTINGS = (
    "-c",
    "listen_addresses=127.0.0.1",
    "-c",
    "max_connections=20",
    "-c",
    "shared_buffers=16MB",
)


def as_nobody_special(*command: str) -> list[str]:
    """PostgreSQL refuses to be root."""
    if os.getuid():
        return list(command)
    return ["setpriv", "--reuid=postgres", "--regid=postgres", "--clear-groups", *command]


class PostgresServer:
    """What it had committed is there again after `kill` and `start`."""

    def __init__(self, folder: Path) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port: int = free.getsockname()[1]
        self._data = folder / "data"
        self._log = folder / "log"
        self._process: subprocess.Popen[bytes] | None = None
        made = as_nobody_special(
            program("initdb"), "-A", "trust", "-U", "postgres", "-N", str(self._data)
        )
        subprocess.run(made, check=True, capture_output=True, cwd=folder, timeout=3 * PATIENCE)
        self.start()

    @property
    def dsn(self) -> str:
        return f"postgresql://postgres@127.0.0.1:{self.port}/postgres"

    def start(self) -> None:
        """Returns when it answers."""
        import psycopg

        place = ("-D", str(self._data), "-p", str(self.port), "-k", str(self._data.parent))
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                as_nobody_special(program("postgres"), *place, *SETTINGS),
                stdout=log,
                stderr=log,
                cwd=self._data.parent,
            )
        until = time.monotonic() + PATIENCE
        while True:
            try:
                psycopg.connect(self.dsn, connect_timeout=1).close()
            except psycopg.OperationalError as error:
                if time.monotonic() > until:
                    raise AssertionError(self._log.read_text()) from error
                time.sleep(0.05)
            else:
                return

    def kill(self) -> None:
        """At once, without a word to anybody: its children notice, and end."""
        self._end(signal.SIGKILL)

    def stop(self) -> None:
        """In good order: it leaves nothing in the machine's shared memory."""
        self._end(signal.SIGINT)

    def _end(self, number: signal.Signals) -> None:
        if self._process is not None:
            self._process.send_signal(number)
            self._process.wait(PATIENCE)
            self._process = None


@contextlib.contextmanager
def postgres_server(folder: Path) -> Iterator[PostgresServer]:
    """In a folder that its user may enter, which those of tests are not."""
    import tempfile

    with tempfile.TemporaryDirectory(
        prefix="multidrop-postgres-", ignore_cleanup_errors=True
    ) as place:
        if not os.getuid():
            shutil.chown(place, "postgres", "postgres")
        server = PostgresServer(Path(place))
        try:
            yield server
        finally:
            server.stop()
