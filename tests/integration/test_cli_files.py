"""Files that are there: a command replaces what it makes itself, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from integration.processes import Simulator, multidrop
from integration.terminal import on_terminal

COMMANDS = {
    "read DEVICE 1009 --capture FILE": "no capture",
    "scan PORT --protocol slink3 --addresses 2 --listen 0 --capture FILE": "no capture",
    "doctor DEVICE --seconds 0 --times 1 --capture FILE": "no capture",
    "sniff PORT --seconds 0.1 -o FILE": "no capture",
    "doctor DEVICE --seconds 0 --times 1 --report FILE": "no report of the doctor",
}


def arguments(command: str, plant: Simulator, file: Path) -> list[str]:
    names = {"DEVICE": plant.device("ax-v:2"), "PORT": plant.port, "FILE": str(file)}
    return [names.get(word, word) for word in command.split()]


@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_there_stays(plant: Simulator, tmp_path: Path, command: str) -> None:
    file = tmp_path / "multidrop.toml"
    file.write_text("[line.press]\n")
    ran = multidrop(*arguments(command, plant, file))
    assert (ran.status, ran.out) == (2, "")
    assert f"{file} is there and {COMMANDS[command]}; it is not replaced" in ran.err
    assert file.read_text() == "[line.press]\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_an_older_one_is_replaced(plant: Simulator, tmp_path: Path, command: str) -> None:
    file = tmp_path / "line"
    file.touch()
    for _ in range(2):
        assert multidrop(*arguments(command, plant, file)).status == 0
        assert file.stat().st_size > 0


def test_a_report_that_is_broken_off_leaves_no_file(plant: Simulator, tmp_path: Path) -> None:
    file = tmp_path / "line.txt"
    with on_terminal("doctor", plant.device("ax-v:2"), "--report", str(file)) as terminal:
        terminal.wait_for("listening")
        assert terminal.interrupt() == 130
    assert not file.exists()
