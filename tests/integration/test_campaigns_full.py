"""The whole gateway on a disk that is full for a while: nothing is lost, nothing is written unrecorded."""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from postgres import own_database

from integration.counting import SOAK, CountingLine, all_is_kept, plant, stop, wait_until
from integration.gateways import Client, tokens
from integration.processes import Running, running
from integration.writes import logged

FULL_FOR = 60.0 if SOAK else 2.0
OVERCURRENT = 0x2310
TABLES = """
[faults]
[http]
listen = "127.0.0.1:0"
tokens = "tokens.toml"
[history]
"""


@dataclass
class Disk:
    """Where a gateway keeps its files; `fill` leaves no byte of room, until `empty`."""

    folder: Path
    fill: Callable[[Running], None]
    empty: Callable[[Running], None]


@contextmanager
def limited(folder: Path) -> Iterator[Disk]:
    """No file of the process may grow, as if by a quota: that needs no rights."""
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(program: Running, size: int) -> None:
        resource.prlimit(program.process.pid, resource.RLIMIT_FSIZE, (size, most))

    yield Disk(folder, lambda program: limit(program, 1), lambda program: limit(program, most))


@contextmanager
def small(folder: Path) -> Iterator[Disk]:
    """A real file system without a free block."""
    place = folder / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(place)]
    if (
        shutil.which("mount") is None
        or subprocess.run(mount, capture_output=True, check=False).returncode
    ):
        pytest.skip("no file system can be mounted here")
    ballast = place / "ballast"

    def fill(program: Running) -> None:
        with ballast.open("wb", buffering=0) as file:
            try:
                while file.write(bytes(4096)):
                    pass
            except OSError:
                return

    try:
        yield Disk(place, fill, lambda program: ballast.unlink())
    finally:
        subprocess.run(["umount", "--lazy", str(place)], check=True)


CASES = [(limited, "postgres"), (small, "sqlite")]
if SOAK:
    CASES += [(limited, "sqlite"), (small, "postgres")]


@pytest.mark.parametrize(("kind", "database"), CASES)
def test_a_disk_that_is_full_for_a_while(
    tmp_path: Path, kind: Callable[[Path], AbstractContextManager[Disk]], database: str
) -> None:
    """History waits in memory, or before the outbox; a write without its record is not made."""
    with ExitStack() as stack:
        disk = stack.enter_context(kind(tmp_path))
        folder = disk.folder
        audit = folder / "audit.jsonl"
        tables = TABLES
        if database == "postgres":
            tables += f'dsn = "{stack.enter_context(own_database())}"\n'
        line = CountingLine("press")
        stack.enter_context(plant(folder, tables, line))
        token, _ = tokens(folder)
        program = stack.enter_context(running("run", cwd=folder, MULTIDROP_AUDIT=str(audit)))
        client = Client(program.wait_for("http://"), token)
        line.wait_for_more(30)
        assert client.write("press", "feed", 5).status == 200
        disk.fill(program)
        until = time.monotonic() + FULL_FOR
        refused = client.write("press", "feed", 7)
        line.drive.drive.trip(OVERCURRENT, 0.0)
        program.wait_for("press: its freeze-frame cannot be kept: ")
        wait_until(lambda: client.get("/api/status").json["history"]["error"])
        while time.monotonic() < until:
            line.wait_for_more(5)
            assert program.process.poll() is None
        assert client.write("press", "feed", 8).status >= 400
        disk.empty(program)
        wait_until(lambda: client.get("/api/status").json["history"]["error"] is None)
        line.wait_for_more(20)
        written = client.write("press", "feed", 9)
        stop(program)
        all_is_kept(folder, [line])
        confirmed = [one["asked"] for one in logged(audit) if one["outcome"] == "confirmed"]
        for file in (folder / "faults").rglob("*.json"):
            json.loads(file.read_text())
    assert (refused.status, "audit log" in refused.reason) == (400, True), refused.body
    assert written.status == 200, written.body
    assert confirmed == [5, 9]
    assert line.drive.parameters.known[8236, 0].value == 9
