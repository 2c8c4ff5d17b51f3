"""`multidrop check`, `run` and `faults` in processes of their own."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from integration.plants import DRIVE
from integration.processes import (
    COMMAND,
    PATIENCE,
    Address,
    Running,
    environment,
    multidrop,
    running,
    simulator,
)
from integration.threads import served
from multidrop.protocols import slink3
from multidrop.sim.line import SimulatedLine
from multidrop.sim.slink3 import FlexMax

Plant = tuple[Path, FlexMax]


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Plant]:
    """A folder with a plant file, and the simulated drive that it names."""
    drive = FlexMax(0)
    with served(SimulatedLine([drive], slink3.decoder)) as address:
        (tmp_path / "multidrop.toml").write_text(text_for(address))
        yield tmp_path, drive


def text_for(address: Address) -> str:
    line = f'[line.press]\nport = "{address.port}"\nbaud = 115200\ntimeout = 0.2\n'
    return line + DRIVE.format(line="press", name="infeed", address=0)


Start = Callable[..., Running]


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts `multidrop run` in a folder; what has not ended is ended with the test."""
    with contextlib.ExitStack() as started:

        def run(folder: Path, *options: str) -> Running:
            audit = str(folder / "audit.jsonl")
            return started.enter_context(
                running("run", *options, cwd=folder, MULTIDROP_AUDIT=audit)
            )

        yield run


def change(folder: Path, old: str, new: str) -> None:
    file = folder / "multidrop.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_check_says_how_full_the_lines_are(site: Plant) -> None:
    folder, _ = site
    done = multidrop("check", cwd=folder)
    assert (done.status, done.err) == (0, "")
    head, line = done.out.splitlines()
    assert head.split() == ["line", "settings", "devices", "points", "load", "port"]
    assert line.startswith("press  slink3 115200 8E1        1       2  ")
    (found,) = multidrop("check", "--json", cwd=folder).objects
    assert (found["line"], found["devices"], found["points"]) == ("press", 1, 2)
    assert 0 < found["load"] < 0.9


def test_check_says_all_that_is_wrong(site: Plant) -> None:
    folder, _ = site
    change(folder, "max = 150", "max = 9999")
    change(folder, "timeout = 0.2", "timeout = 0.2\n[htp]\n[line.other]\n")
    done = multidrop("check", cwd=folder)
    assert done.status == 2
    assert len(done.err.splitlines()) == 3
    *_, last = multidrop("check", "--json", cwd=folder).objects
    assert last["error"]["kind"] == "usage"
    refused = multidrop("run", cwd=folder)
    assert (refused.status, refused.out) == (2, "")
    assert refused.err == done.err


def test_check_of_a_file_that_is_not_there(tmp_path: Path) -> None:
    done = multidrop("check", cwd=tmp_path)
    assert (done.status, done.err) == (2, "multidrop.toml: No such file or directory\n")
    assert multidrop("run", "other.toml", cwd=tmp_path).status == 2


def test_every_update_as_a_line_of_json(start: Start, site: Plant) -> None:
    folder, drive = site
    drive.drive.speed_setpoint = 7
    program = start(folder, "--json")
    program.wait_for('"point": "feed"')
    done = program.end(signal.SIGTERM)
    assert done.status == 0
    found = [json.loads(line) for line in done.out.splitlines()]
    feed = next(one for one in found if one["point"] == "feed")
    assert (feed["v"], feed["device"], feed["quality"]) == (1, "infeed", "good")
    assert (feed["value"], feed["unit"], feed["raw"], feed["fault"]) == (
        0.0,
        "m/min",
        "0000",
        False,
    )
    assert feed["time"] <= feed["at"]
    assert feed["time"].endswith("Z")
    assert feed["synchronised"] in (True, False, None)
    assert done.err == "polling 1 device on 1 line"


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_it_ends_as_it_is_told(
    start: Start, site: Plant, number: signal.Signals, status: int
) -> None:
    folder, _ = site
    program = start(folder)
    program.wait_for("polling 1 device on 1 line")
    done = program.end(number)
    assert (done.status, done.out) == (status, "")
    assert "Traceback" not in done.err


def test_it_runs_while_nothing_is_there_and_says_so(start: Start, tmp_path: Path) -> None:
    with served(SimulatedLine([FlexMax(0)], slink3.decoder)) as address:
        text = text_for(address)
    (tmp_path / "multidrop.toml").write_text(text)
    program = start(tmp_path, "--json")
    program.wait_for("line press: port lost: cannot open ")
    line: dict[str, Any] = json.loads(program.wait_for('"quality": "port lost"'))
    assert (line["value"], line["time"], line["error"]["kind"]) == (None, None, "port")
    assert program.end(signal.SIGTERM).status == 0


def test_sighup_reads_the_file_again(start: Start, site: Plant) -> None:
    folder, _ = site
    program = start(folder, "--json")
    program.wait_for('"point": "feed"')
    change(folder, "feed =", "rate =")
    program.process.send_signal(signal.SIGHUP)
    program.wait_for("reloaded: changed press")
    program.wait_for('"point": "rate"')
    change(folder, "max = 150", "max = 9999")
    program.process.send_signal(signal.SIGHUP)
    program.wait_for("not reloaded: ")
    program.wait_for('"point": "rate"')
    change(folder, "max = 9999", "max = 150")
    with (folder / "multidrop.toml").open("a") as file:
        file.write("[faults]\n")
    program.process.send_signal(signal.SIGHUP)
    program.wait_for("reloaded: unchanged press")
    program.wait_for("what changed beside the lines counts from the next start on")
    assert program.end(signal.SIGTERM).status == 0
    assert "port lost" not in "\n".join(program.err)


def test_faults_shows_why_it_tripped(start: Start, site: Plant) -> None:
    folder, drive = site
    with (folder / "multidrop.toml").open("a") as file:
        file.write("[faults]\n")
    assert multidrop("faults", "infeed", cwd=folder).out == "infeed: no freeze-frame is kept\n"
    program = start(folder)
    program.wait_for("polling")
    for code in (0x2310, 0x3210):
        drive.drive.trip(code, 0.0)
        program.wait_for(f"infeed: FAULT, malfunction code {code:04X}h")
        drive.drive.control(0, 0.0)
        drive.drive.control(0x80, 0.0)
        program.wait_for("infeed: no fault any more")
    assert program.end(signal.SIGTERM).status == 0
    done = multidrop("faults", "infeed", cwd=folder)
    first, second, *rest = done.out.splitlines()
    assert first.endswith("malfunction code 3210h")
    assert second.endswith("malfunction code 2310h")
    assert "  malfunction code   3210h (voltage)" in rest
    newest, oldest = multidrop("faults", "infeed", "--json", cwd=folder).objects
    assert newest["time"] > oldest["cleared"] > oldest["time"]
    assert newest["status"]["malfunction_code"] == 0x3210
    assert "2310h (current)" in multidrop("faults", "infeed", "2", cwd=folder).out
    wrong = multidrop("faults", "infeed", "3", cwd=folder)
    assert (wrong.status, wrong.out) == (2, "")
    assert "infeed has 2 freeze-frames" in wrong.err
    unknown = multidrop("faults", "infed", cwd=folder)
    assert unknown.status == 2
    assert "did you mean 'infeed'" in unknown.err


def test_a_reader_that_goes_away_ends_it(site: Plant) -> None:
    folder, _ = site
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {COMMAND} run --json | head -n 3"],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert (done.returncode, len(done.stdout.splitlines())) == (0, 3)
    assert "Traceback" not in done.stderr


def test_it_goes_on_when_its_terminal_is_gone(tmp_path: Path) -> None:
    """Started by hand over a connection that breaks: what it has to say goes nowhere."""
    terminal, other = pty.openpty()
    with simulator("flexmax:0") as address:
        (tmp_path / "multidrop.toml").write_text(text_for(address) + "[history]\n")
        started = subprocess.Popen(
            [COMMAND, "run"],
            cwd=tmp_path,
            env=environment(),
            stdin=other,
            stdout=other,
            stderr=other,
        )
        os.close(other)
        said = b""
        while b"polling" not in said:
            said += os.read(terminal, 1000)
        time.sleep(0.5)  # it polls
        os.close(terminal)
    try:
        with contextlib.suppress(subprocess.TimeoutExpired):
            started.wait(1.5)  # the port is lost, which would be said
        started.terminate()
        assert started.wait(PATIENCE) == 0
    finally:
        started.kill()
        started.wait()
    recorded = multidrop("history", "export", "infeed", "feed", cwd=tmp_path).out
    assert recorded.splitlines()[-1].split(",")[2] in ("port lost", "no reply")  # it saw that
