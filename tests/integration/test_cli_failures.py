"""What goes wrong with a device or a port is a JSON line of every command that has --json."""

from __future__ import annotations

import pytest

from integration.processes import Simulator, multidrop

NOBODY = "tcp://127.0.0.1:1"
COMMANDS = [
    "backup DEVICE -o new.toml",
    "diff PASSPORT DEVICE",
    "diff DEVICE PASSPORT",
    "restore PASSPORT DEVICE --include unknown --yes",
    "restore PASSPORT DEVICE --include unknown --dry-run",
    "raw DEVICE 2300",
]


@pytest.fixture(scope="module")
def passport(tmp_path_factory: pytest.TempPathFactory, plant: Simulator) -> str:
    path = tmp_path_factory.mktemp("passports") / "winder.passport.toml"
    assert multidrop("backup", plant.device("ax-v:2"), "-o", str(path)).status == 0
    return str(path)


def fails(command: str, device: str, passport: str, kind: str) -> int:
    """The command with a device that fails; returns its exit status."""
    names = {"DEVICE": device, "PASSPORT": passport}
    arguments = [names.get(word, word) for word in command.split()]
    ran = multidrop(*arguments, "--json", "--timeout", "0.05")
    assert ran.object["v"] == 1
    assert ran.object["device"] == device
    assert ran.object["error"]["kind"] == kind
    assert ran.err != ""
    return ran.status


@pytest.mark.parametrize("command", COMMANDS)
def test_a_device_that_does_not_answer(plant: Simulator, passport: str, command: str) -> None:
    assert fails(command, plant.device("ax-v:5"), passport, "no-reply") == 4


@pytest.mark.parametrize("command", [*COMMANDS, "watch DEVICE 1009", "read DEVICE 1009"])
def test_the_port_of_a_device_that_cannot_be_opened(passport: str, command: str) -> None:
    assert fails(command, f"ax-v:2@{NOBODY}", passport, "port") == 5


@pytest.mark.parametrize(
    "command", [("scan",), ("doctor",), ("sniff",), ("share", "--listen", "tcp://127.0.0.1:0")]
)
def test_a_port_that_cannot_be_opened(command: tuple[str, ...]) -> None:
    name, *options = command
    ran = multidrop(name, NOBODY, *options, "--json")
    assert ran.status == 5
    assert ran.object["port"] == NOBODY
    assert ran.object["error"]["kind"] == "port"
    assert ran.err.count("cannot open") == 1
