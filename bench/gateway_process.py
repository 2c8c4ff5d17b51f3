"""`multidrop run` in a process of its own, and what lives beside it: a broker, browsers, a subscriber.

`python -m bench.gateway_process FILE` is `multidrop run FILE` for a plant whose lines are
fuller than `multidrop check` lets them be.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from bench.measure import ROOT, line_of, start

TICKS = os.sysconf("SC_CLK_TCK")
STARTED_WITHIN, POLLED_WITHIN = 30.0, 60.0  # s
TOPIC = "bench"


def cores() -> tuple[int, int, int]:
    """The gateway's core, the simulator's, and one for the rest: the simulator's where there are two."""
    gateway, simulator, *others = sorted(os.sched_getaffinity(0))
    return gateway, simulator, others[0] if others else simulator


class GatewayProcess:
    """A gateway on a plant file, on one core. `full`: its lines may be fuller than they should be."""

    def __init__(self, file: Path, core: int, *, full: bool = False) -> None:
        command = ["-m", "bench.gateway_process"] if full else ["-m", "multidrop", "run"]
        self.errors = file.with_suffix(".err")
        with self.errors.open("w") as errors:
            self._process = subprocess.Popen(
                [sys.executable, *command, str(file)],
                cwd=ROOT,
                env={**os.environ, "MULTIDROP_AUDIT": str(file.with_suffix(".audit"))},
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
        os.sched_setaffinity(self._process.pid, {core})
        self.http = 0
        """The port of its page."""

    def ready(self) -> None:
        """Returns once its page can be asked. Raises `RuntimeError` where it ended."""
        while not self.http:
            try:
                line = line_of(self._process.stdout)
            except RuntimeError:
                raise RuntimeError(self.errors.read_text()) from None
            if line.startswith("http://"):
                self.http = urlsplit(line).port or 0

    @property
    def used(self) -> float:
        """s of processor time so far, of all its threads."""
        fields = self._proc("stat").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICKS  # utime, stime

    @property
    def resident(self) -> float:
        """MB (10^6 bytes) of memory that it occupies now."""
        line = next(line for line in self._proc("status").splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) * 1024 / 1e6

    def _proc(self, name: str) -> str:
        return Path(f"/proc/{self._process.pid}/{name}").read_text()

    def end(self) -> None:
        self._process.send_signal(signal.SIGTERM)
        self._process.communicate(timeout=STARTED_WITHIN)


@contextlib.contextmanager
def gateway(file: Path, core: int, *, full: bool = False) -> Iterator[GatewayProcess]:
    """A gateway that runs, until the end of the block."""
    process = GatewayProcess(file, core, full=full)
    try:
        process.ready()
        yield process
    finally:
        process.end()


@contextlib.contextmanager
def simulated(module: str, *arguments: object) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """A simulator in a process of its own, and the ports of its lines."""
    process = start(module, *map(str, arguments))
    try:
        yield process, json.loads(line_of(process.stdout))
    finally:
        process.communicate()


def wait_until(ready: Callable[[], bool]) -> None:
    """Raises `RuntimeError` where it takes too long."""
    until = time.monotonic() + POLLED_WITHIN
    while not ready():
        if time.monotonic() > until:
            raise RuntimeError(f"not every line was polled within {POLLED_WITHIN:.0f} s")
        time.sleep(0.2)


def asked(process: subprocess.Popen[str], question: str) -> Any:
    """What such a process answers."""
    assert process.stdin is not None
    print(question, file=process.stdin, flush=True)
    return json.loads(line_of(process.stdout))


# -- MQTT ------------------------------------------------------------------------------------


def program(name: str) -> str | None:
    """Where one of Mosquitto's programs is; None where it is not installed."""
    return shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin")


def mqtt_missing() -> str | None:
    """Why nothing can be said of MQTT; None where it can."""
    missing = [name for name in ("mosquitto", "mosquitto_sub") if program(name) is None]
    return f"{' and '.join(missing)} not installed (make mosquitto)" if missing else None


@contextlib.contextmanager
def broker(folder: Path, core: int) -> Iterator[int | None]:
    """The port of a Mosquitto of our own; None where it is not installed."""
    if mqtt_missing():
        yield None
        return
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    file = folder / "mosquitto.conf"
    # the queue must not drop what comes in a burst: that would be the bench's own fault
    file.write_text(
        f"listener {port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\nuser root\n"
    )
    with (folder / "mosquitto.log").open("w") as log:
        process = subprocess.Popen(
            [str(program("mosquitto")), "-c", str(file)], stdout=log, stderr=log
        )
    os.sched_setaffinity(process.pid, {core})
    try:
        _listens(port)
        yield port
    finally:
        process.terminate()
        process.wait()


def _listens(port: int) -> None:
    until = time.monotonic() + STARTED_WITHIN
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return
        if time.monotonic() > until:
            raise RuntimeError("mosquitto does not listen")
        time.sleep(0.02)


class Subscriber:
    """Mosquitto's own client, subscribed to all states: what came, and when."""

    def __init__(self, port: int, folder: Path, core: int) -> None:
        self._file = folder / "states.txt"
        with self._file.open("w") as file:
            self._process = subprocess.Popen(
                [
                    *(str(program("mosquitto_sub")), "-h", "127.0.0.1", "-p", str(port)),
                    *("-t", f"{TOPIC}/+/+", "-F", "%U %t %p"),
                ],
                stdout=file,
            )
        os.sched_setaffinity(self._process.pid, {core})

    def end(self) -> list[tuple[str, str, Any, float]]:
        """Device, point, value, and when it came (monotonic, s)."""
        self._process.terminate()
        self._process.wait()
        shift = time.time() - time.monotonic()
        found = []
        for line in self._file.read_text().splitlines():
            at, _, rest = line.partition(" ")
            topic, _, payload = rest.partition(" ")
            _, device, point = topic.split("/")
            found.append((device, point, json.loads(payload)["value"], float(at) - shift))
        return found


if __name__ == "__main__":
    from multidrop.cli import main
    from multidrop.gateway import check

    check.FULLEST = float("inf")
    sys.argv[1:1] = ["run"]
    main()
