"""`multidrop doctor` over TCP and pseudo-terminals, and against other masters."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from integration.processes import Ran, multidrop, running, simulator
from integration.servers import Connected, serving
from integration.terminal import on_terminal
from integration.threads import served
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.slink3 import Frame
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault, ScriptedFaults
from multidrop.sim.line import LineFaults, Pace, SimulatedLine

QUICK = ("--seconds", "0.1", "--times", "4")
POLL = Frame(11, 0x0C, 0, 0x26, b"\x03\xf1\x03").encode()


def line(*devices: tuple[str, int], faults: object = (), **options: object) -> SimulatedLine:
    settings = PROTOCOLS["slink3"].line
    return SimulatedLine(
        [simulated_device(*device) for device in devices],
        settings.decoder,
        character=settings.character,
        pace=Pace(settings.character),
        faults=LineFaults(ScriptedFaults(faults), **options),  # type: ignore[arg-type]
    )


def doctor(*arguments: str, cwd: Path | None = None) -> Ran:
    return multidrop("doctor", *arguments, *QUICK, cwd=cwd)


def what(ran: Ran) -> list[str]:
    return [item["verdict"] for item in ran.objects]


@pytest.mark.parametrize(
    ("faults", "options", "verdict", "status"),
    [
        ((), {}, "healthy", 0),
        ((None, Fault.WRONG_CHECKSUM), {}, "damaged-answers", 6),
        ((None, Fault.GAP), {}, "gaps", 6),
        ((Fault.TWICE, Fault.TWICE), {}, "same-address", 6),
        ((Fault.LATE_ANSWER,), {"late": 2.2}, "late-answers", 4),
    ],
)
def test_over_tcp(
    faults: tuple[Fault | None, ...], options: dict[str, float], verdict: str, status: int
) -> None:
    with served(line(("flexmax", 0), faults=faults, **options)) as where:
        ran = doctor(where.device("flexmax:0"), "--json")
    assert what(ran)[0] == verdict
    assert ran.status == status
    assert ran.objects[0]["status"] == status
    assert ran.objects[0]["port"] == where.port


def test_all_protocols_are_asked_where_none_is_named() -> None:
    with simulator("53mc5000:3") as where:
        ran = doctor(where.port, "--addresses", "2..8", "--json")
    assert what(ran) == ["healthy"]
    assert "datalink 9600 8E1" in ran.objects[0]["text"]


def test_a_line_that_is_not_there() -> None:
    with served(line()) as where:
        ran = doctor(where.device("flexmax:0"))
    assert ran.status == 4
    assert ran.out.startswith("not one byte came back: 2 reads of 1 address at slink3 9600 8E1\n")
    assert "\n  - check A and B" in ran.out


def test_a_port_that_cannot_be_opened() -> None:
    ran = doctor("flexmax:0@tcp://127.0.0.1:1")
    assert ran.status == 5
    assert "nothing listens there" in ran.err


@pytest.mark.parametrize("burst", ["16", "0"])
def test_bursts_over_a_pseudo_terminal(tmp_path: Path, burst: str) -> None:
    """The adapter's latency, seen in when bytes come, and not taken for anything else."""
    where = f"pty:{tmp_path}/line"
    with simulator("flexmax:0", "--pace", "--delay", "3", "--burst", burst, listen=where) as found:
        ran = doctor(f"flexmax:0@{found.port}", "--json")
    assert ran.status == 0
    assert what(ran)[0] == "healthy"
    if burst != "0":
        assert what(ran) == ["healthy", "adapter-latency"]
        assert "latency_timer" in ran.objects[1]["advice"][0]


def polling(connection: Connected) -> None:
    while True:
        connection.send(POLL)
        connection.pause(0.02)


def test_another_master_is_not_spoken_over(tmp_path: Path) -> None:
    with serving(polling) as server:
        ran = multidrop("doctor", server.port, "--seconds", "0.5")
        assert server.frames() == []
    assert ran.status == 6
    assert ran.out.startswith("a master speaks slink3")
    assert "so nothing was sent" in ran.out


def test_listening_to_a_line_that_another_master_runs() -> None:
    tap = "tcp://127.0.0.1:0"
    with simulator("ax-v:2", "--pace", "--tap", tap) as where:
        heard = where.program.wait_for("listen to it at").rpartition(" ")[2]
        listening = ("doctor", heard, "--listen-only", "--seconds", "600", "--json", "--trace")
        with running(*listening) as program:
            while not program.err:  # it is not there yet
                multidrop("read", where.device("ax-v:2"), "1009")
            for _ in range(2):
                multidrop("read", where.device("ax-v:2"), "1009")
            ran = program.interrupt()
    assert what(ran) == ["healthy", "another-master"]
    assert ran.status == 0


def test_the_report(tmp_path: Path) -> None:
    with served(line(("flexmax", 0))) as where:
        ran = doctor(where.device("flexmax:0"), "--report", "line.txt", cwd=tmp_path)
    assert ran.err == "every byte is in line.txt\n"
    text = (tmp_path / "line.txt").read_text()
    assert "[healthy]\nthe line is healthy: 4 of 4 reads" in text
    assert "== slink3 9600 8E1; answer 1.8 s" in text
    assert text.count("> 01 00") == 4


def test_a_report_that_cannot_be_written_stops_it_before_anything_is_sent(tmp_path: Path) -> None:
    ran = doctor("flexmax:0@tcp://127.0.0.1:1", "--report", str(tmp_path / "no" / "where"))
    assert ran.status == 2
    assert "there is no folder" in ran.err


def test_traces_and_captures(tmp_path: Path) -> None:
    with served(line(("flexmax", 0))) as where:
        device = where.device("flexmax:0")
        ran = doctor(device, "--trace", "--capture", "line.pcapng", cwd=tmp_path)
    assert "> 01 00 00 08 00 23 00 2B  | 0 #0 status word" in ran.err
    assert multidrop("decode", "line.pcapng", cwd=tmp_path).out.count("status word") == 4


PLANT = """
[line.press]
port = "{port}"
[line.press.device.infeed]
profile = "flexmax"
address = 0
[line.press.device.winder]
profile = "flexmax"
address = 3
"""


@pytest.mark.parametrize(("name", "devices"), [("press", "0, 3"), ("infeed", "0")])
def test_names_of_the_plant_file(tmp_path: Path, name: str, devices: str) -> None:
    with served(line(("flexmax", 0), ("flexmax", 3))) as where:
        (tmp_path / "multidrop.toml").write_text(PLANT.format(port=where.port))
        ran = doctor(name, cwd=tmp_path)
    assert f"({devices}) answered" in ran.out
    assert ran.status == 0


def test_ctrl_c_while_it_asks() -> None:
    with served(line()) as where, running("doctor", where.device("flexmax:0")) as program:
        time.sleep(3.0)  # it has listened, and waits for an answer
        ran = program.interrupt()
    assert ran.status == 130
    assert "Traceback" not in ran.err


def test_ctrl_c_ends_the_listening_with_a_verdict() -> None:
    with serving(polling) as server:
        with running("doctor", server.port, "--listen-only", "--seconds", "600") as program:
            server.await_connections(1)
            time.sleep(1.0)
            ran = program.interrupt()
        assert server.frames() == []
    assert ran.out.startswith("address 11 left")  # nobody answers that master
    assert "a master speaks slink3" in ran.out
    assert ran.status == 4


def test_progress_on_a_terminal() -> None:
    with served(line()) as where, on_terminal("doctor", where.device("flexmax:0")) as terminal:
        terminal.wait_for("listening at 9600 8E1")
        terminal.wait_for("asking 0")
