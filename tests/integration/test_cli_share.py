"""`share` as a command: what it prints, what it refuses, and how it ends."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from integration.processes import Address, Running, Simulator, multidrop, running
from integration.writes import logged


class Shared(Address):
    """`multidrop share` in a process of its own."""

    def __init__(self, program: Running) -> None:
        self.program = program
        super().__init__(program.wait_for("listening on ").removeprefix("listening on "))


@contextmanager
def share(port: str, *arguments: str, listen: str = "tcp://127.0.0.1:0") -> Iterator[Shared]:
    with running("share", port, "--listen", listen, *arguments) as program:
        yield Shared(program)


def test_read_and_a_write_that_is_refused(plant: Simulator) -> None:
    with share(plant.port) as shared:
        device = shared.device("ax-v:2")
        read = multidrop("read", device, "1009", "--json")
        assert (read.status, read.object["value"]) == (0, 125)
        write = multidrop("write", device, "1111=7", "--json")
        assert write.status == 3
        assert write.object["error"]["code"] == 0x1A
        ran = shared.program.interrupt()
    assert ran.out == f"listening on {shared.port}"
    assert ran.status == 130
    lines = [line for line in ran.err.splitlines() if line]
    assert sum("write refused: 2 #" in line for line in lines) == 1
    assert sum(line.endswith(" came") for line in lines) == 2
    assert sum(" went: " in line for line in lines) == 2
    assert lines[-2:] == ["2 clients, 2 requests, 2 answers, 1 write refused", "interrupted"]


def test_a_write_that_is_allowed(fresh: Address, audit: Path) -> None:
    with share(fresh.port, "--allow-writes") as shared:
        ran = multidrop("write", shared.device("ax-v:2"), "1111=7", "--json")
        assert (ran.status, ran.object["outcome"]) == (0, "confirmed")
        assert shared.program.end(signal.SIGTERM).status == 0
    by_share, by_client = logged(audit)
    assert (by_share["from"], by_client["from"]) == ("share", "command line")
    assert by_share["who"].startswith("127.0.0.1:")


def test_as_json(plant: Simulator) -> None:
    with running("share", plant.port, "--listen", "tcp://127.0.0.1:0", "--json") as program:
        port = json.loads(program.wait_for('"listening"'))["port"]
        assert multidrop("read", f"ax-v:2@{port}", "1009").status == 0
        program.wait_for('"client-gone"')
        ran = program.interrupt()
    events = ["listening", "client-come", "port-open", "client-gone", "summary"]
    assert [line["event"] for line in ran.objects] == events
    assert ran.objects[-1]["answers"] == 1
    assert ran.err.strip() == "interrupted"


def test_trace_and_capture(plant: Simulator, tmp_path: Path) -> None:
    """Of the wire: the numbers are those of the line."""
    file = tmp_path / "wire.pcapng"
    with share(plant.port, "--trace", "--capture", str(file)) as shared:
        for _ in range(2):
            assert multidrop("read", shared.device("ax-v:2"), "1009:int16").status == 0
        ran = shared.program.interrupt()
    assert "2 #0 read typed parameter 1009:int16" in ran.err
    assert "2 #1 read typed parameter 1009:int16" in ran.err
    decoded = multidrop("decode", str(file))
    assert decoded.status == 0
    assert decoded.out.count("= 125") == 2


def test_a_pseudo_terminal(plant: Simulator, tmp_path: Path) -> None:
    with share(plant.port, listen=f"pty:{tmp_path}/line") as shared:
        for _ in range(2):
            assert multidrop("read", shared.device("ax-v:2"), "1009").status == 0


def test_beyond_this_machine(plant: Simulator) -> None:
    with share(plant.port, listen="tcp://0.0.0.0:0") as shared:
        shared.program.prints("warning: a raw socket asks for no password")


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("tcp://127.0.0.1:1",), 2, "where? --listen"),
        (("tcp://127.0.0.1:1", "--listen", "udp://x"), 5, "connection refused"),
        (("tcp://127.0.0.1:1", "--listen", "tcp://127.0.0.1:0"), 5, "connection refused"),
        (("/dev/nowhere", "--listen", "tcp://127.0.0.1:0"), 5, "no such port"),
        (("/dev/x,baut=9600", "--listen", "tcp://127.0.0.1:0"), 2, "did you mean 'baud'"),
        (("/dev/x,baud", "--listen", "tcp://127.0.0.1:0"), 2, "'baud' is not key=value"),
        (("", "--listen", "tcp://127.0.0.1:0"), 2, "is not a port"),
        (("/dev/x", "--listen", "pty", "--protocol", "modbus"), 2, "modbus"),
        (("/dev/x", "--listen", "pty", "--attempts", "2"), 2, "its clients repeat"),
        (("/dev/x", "--listen", "pty", "--profile", "x.toml"), 2, "no profile is needed"),
    ],
)
def test_what_cannot_be_shared(arguments: tuple[str, ...], status: int, message: str) -> None:
    ran = multidrop("share", *arguments)
    assert (ran.status, ran.out) == (status, "")
    assert message in ran.err
