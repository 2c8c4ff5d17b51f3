"""`simulate`: what is printed, what is refused, plant files, pace, faults, and who ends it."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from integration.processes import multidrop, running, simulator


def test_it_prints_where_it_listens() -> None:
    with simulator("ax-v:2") as started:
        assert started.port.startswith("tcp://127.0.0.1:")
        assert multidrop("read", started.device("ax-v:2"), "1009").status == 0
        ran = started.program.interrupt()
    assert ran.out == f"listening on {started.port}"
    assert (ran.status, ran.err.strip()) == (130, "interrupted")


def test_sigterm_is_a_clean_end() -> None:
    with simulator("ax-v:2") as started:
        ran = started.program.end(signal.SIGTERM)
    assert (ran.status, ran.err) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("flexmax:0",), "where? --listen tcp://127.0.0.1:4001 or --listen pty:"),
        (("flexmax:0", "--listen", "udp://1"), "is no address to listen on"),
        (("flexmx:0", "--listen", "pty"), "did you mean 'flexmax'"),
        (("flexmax:200", "--listen", "pty"), "a slave has 0..127"),
        (("flexmax:1", "ax-v:1", "--listen", "pty"), "address 1 is used twice"),
        (("flexmax", "--listen", "pty"), "'flexmax' is not a device"),
        (("ax-v:1+dgfc386", "--listen", "pty"), "ax-v has no dgfc386 behind it"),
        (("flexmax:0", "--listen", "pty", "--fault", "nois=1%"), "did you mean 'noise'"),
        (("flexmax:0", "--listen", "pty", "--delay", "-1"), "--delay and --late are times"),
        (("flexmax:0", "--listen", "pty", "--baud", "9"), "baud rate 9 is out of range"),
        (("plant.toml", "ax-v:2"), "plant.toml has its own devices: leave ax-v:2 away"),
        (("nowhere.toml",), "nowhere.toml: No such file"),
        ((), "which devices? As in flexmax:0"),
    ],
)
def test_what_cannot_be_simulated(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    ran = multidrop("simulate", *arguments, cwd=tmp_path)
    assert (ran.status, ran.out) == (2, "")
    assert message in ran.err


def test_a_port_that_is_taken() -> None:
    with simulator("ax-v:2") as started:
        ran = multidrop("simulate", "ax-v:2", "--listen", started.port)
    assert ran.status == 5
    assert f"cannot listen on {started.port}: " in ran.err


def test_paced_to_the_baud_rate() -> None:
    """No read is quicker than the line, and the quickest little slower: a busy machine only adds to it."""
    least = 24 * 11 / 9.6 + 5
    with (
        simulator("ax-v:2", "--pace", "--delay", "5") as paced,
        running("read", paced.device("ax-v:2"), "1009", "--every", "0", "--json") as reading,
    ):
        times = [json.loads(reading.wait_for('"ms"'))["ms"] for _ in range(9)]
    assert least <= min(times) < least + 15


def test_faults_on_demand_with_a_seed() -> None:
    found = []
    for _ in range(2):
        with simulator("ax-v:2", "--fault", "no-answer=50%", "--seed", "3") as faulty:
            device = faulty.device("ax-v:2", timeout=0.2, attempts=1)
            ran = multidrop("read", device, "1009", "1111", "1009:int16", "1111:int16", "--json")
        found.append(["error" in line for line in ran.objects])
    assert found[0] == found[1]
    assert ran.status == 4


def test_echo() -> None:
    with simulator("ax-v:2", "--echo") as echoing:
        for echo in ("auto", "on"):
            ran = multidrop("write", echoing.device("ax-v:2", echo=echo), "1111=5", "--json")
            assert ran.object["outcome"] == "confirmed"


def test_a_plant_file(tmp_path: Path) -> None:
    plant = tmp_path / "plant.toml"
    plant.write_text(
        f"""
        [line.press]
        port = "tcp://127.0.0.1:0"
        [line.press.device.infeed]
        profile = "flexmax"
        address = 0
        behind = "dgfc386"
        [line.press.device.winder]
        profile = "ax-v"
        address = 2
        [line.mill]
        port = "{tmp_path}/mill"
        [line.mill.device.roll]
        profile = "flexmax"
        address = 1
        """
    )
    with running("simulate", str(plant)) as simulating:
        press = simulating.wait_for("listening on tcp").removeprefix("listening on ")
        mill = simulating.wait_for("listening on ").removeprefix("listening on ")
        assert mill == f"{tmp_path}/mill"
        ran = multidrop("read", f"flexmax:0@{press}", "8236", "dgfc/511", "--json")
        assert [line["value"] for line in ran.objects] == [0, 0]
        assert multidrop("read", f"ax-v:2@{press}", "1009").status == 0
        assert multidrop("read", "roll", "8236", "--config", str(plant)).status == 0
        assert simulating.interrupt().status == 130
    assert not (tmp_path / "mill").is_symlink()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no devices to simulate"),
        ("[line.a]\n", "line.a.port is missing"),
        ("[lin.a]\n", "unknown key 'lin' - did you mean 'line'"),
        ("line = 3\n", "is not a table"),
        ("[line.a\n", "not TOML"),
        (
            '[line.a]\nport = "pty"\n[line.a.device.b]\nprofil = "ax-v"\n',
            "unknown key 'profil' - did you mean 'profile'",
        ),
        (
            '[line.a]\nport = "pty"\n[line.a.device.b]\nprofile = "ax-v"\naddress = "2"\n',
            "b.address is missing or not a whole number",
        ),
    ],
)
def test_a_plant_file_that_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    plant = tmp_path / "plant.toml"
    plant.write_text(text)
    ran = multidrop("simulate", str(plant))
    assert ran.status == 2
    assert message in ran.err
    assert "plant.toml" in ran.err


def test_a_plant_file_and_listen(tmp_path: Path) -> None:
    plant = tmp_path / "plant.toml"
    plant.write_text(
        '[line.a]\nport = "tcp://127.0.0.1:0"\n[line.a.device.b]\nprofile = "ax-v"\naddress = 2\n'
    )
    ran = multidrop("simulate", str(plant), "--listen", "tcp://127.0.0.1:0")
    assert ran.status == 2
    assert "leave --listen and --stuffing away" in ran.err
