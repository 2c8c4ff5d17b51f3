"""Questions, live tables and Ctrl-C on a real terminal."""

from __future__ import annotations

import os
import pty
import subprocess
from pathlib import Path

import pytest

from integration.processes import COMMAND, PATIENCE, Address, Simulator, environment, multidrop
from integration.terminal import on_terminal
from integration.ways import state_of


def test_a_command_is_asked_about_and_done(fresh: Address) -> None:
    device = fresh.device("flexmax:0")
    with on_terminal("write", device, "control_word=6") as terminal:
        shown = terminal.wait_for("[y/N]")
        assert f"control_word (std/0x6040.0)=6 may start, stop or switch {device}" in shown
        terminal.type("y\n")
        assert terminal.ended() == 0
        assert "confirmed" in terminal.shown
    assert state_of(device) == "ready to switch on"


@pytest.mark.parametrize("answer", ["n\n", "\n"])
def test_a_command_that_is_not_confirmed_is_not_sent(
    plant: Simulator, audit: Path, answer: str
) -> None:
    device = plant.device("flexmax:0")
    with on_terminal("write", device, "control_word=6") as terminal:
        terminal.wait_for("[y/N]")
        terminal.type(answer)
        assert terminal.ended() == 2
        assert "not confirmed; nothing was sent" in terminal.shown
    assert state_of(device) == "switch-on disabled"
    assert not audit.exists() or audit.read_text() == ""


def test_a_question_names_what_moves_and_what_nobody_knows(plant: Simulator) -> None:
    device = plant.device("flexmax:0")
    with on_terminal("write", device, "8236=5", "control_word=6") as terminal:
        shown = terminal.wait_for("[y/N]")
        assert "control_word (std/0x6040.0)=6 may start, stop or switch" in shown
        assert f"no profile says what index_8236 (8236)=5 does: it may move {device}" in shown
        assert terminal.interrupt() == 130
    ran = multidrop("read", device, "8236")
    assert " 0 " in ran.out


def test_ctrl_c_at_a_question(plant: Simulator) -> None:
    device = plant.device("flexmax:0")
    with on_terminal("write", device, "control_word=6") as terminal:
        terminal.wait_for("[y/N]")
        assert terminal.interrupt() == 130
        assert "Traceback" not in terminal.shown
    assert state_of(device) == "switch-on disabled"


@pytest.mark.parametrize(
    "arguments",
    [
        ("write", "flexmax:1", "control_word=0", "--yes"),
        ("write", "flexmax:1", "speed_setpoint=1"),  # no command: no question
        ("write", "flexmax:1", "8236=1", "--yes"),
        ("clear-faults", "flexmax:1", "--yes"),
        ("raw", "flexmax:1", "2300", "--yes"),
        ("read", "flexmax:1", "8236"),
    ],
    ids=" ".join,
)
def test_where_nothing_is_asked(fresh: Address, arguments: tuple[str, ...]) -> None:
    command, who, *rest = arguments
    with on_terminal(command, fresh.device(who), *rest) as terminal:
        assert terminal.ended() == 0
        assert "[y/N]" not in terminal.shown


@pytest.mark.parametrize(
    "arguments",
    [
        ("clear-faults", "flexmax:1"),
        ("raw", "flexmax:1", "2300"),
        ("reset-comm", "flexmax:1"),
        ("write", "flexmax:1", "8236=1"),  # nobody knows what it is
        ("write", "flexmax:1", "speed_setpoint=1", "64000:int16=1"),
        ("broadcast", "flexmax", "8236:int16=1", "--verify", "0"),
    ],
    ids=" ".join,
)
def test_where_something_is_asked(plant: Simulator, arguments: tuple[str, ...]) -> None:
    command, who, *rest = arguments
    with on_terminal(command, plant.device(who), *rest) as terminal:
        terminal.wait_for("[y/N]")
        terminal.type("n\n")
        assert terminal.ended() == 2


def test_watch_is_a_live_table(fresh: Address) -> None:
    device = fresh.device("flexmax:0")
    with on_terminal("watch", device, "8236", "actual_speed", "--every", "0.05") as terminal:
        shown = terminal.wait_for("actual_speed")
        assert "trend" in shown
        multidrop("write", device, "8236=4321")
        terminal.wait_for("4321")
        terminal.wait_for("█")  # its trend
        assert terminal.interrupt() == 130
        assert "Traceback" not in terminal.shown


def test_the_demo_is_a_live_table() -> None:
    with on_terminal("demo", "--terminal", "--listen", "tcp://127.0.0.1:0") as terminal:
        terminal.wait_for("winder")
        terminal.wait_for("rpm")
        assert terminal.interrupt() == 130
        assert "Traceback" not in terminal.shown


def test_ctrl_c_typed_while_a_read_repeats(plant: Simulator) -> None:
    with on_terminal("read", plant.device("ax-v:2"), "1009", "--every", "0.05") as terminal:
        terminal.wait_for("125")
        assert terminal.interrupt() == 130
        assert "interrupted" in terminal.shown
        assert "Traceback" not in terminal.shown


def test_errors_are_red_on_a_terminal_alone(plant: Simulator) -> None:
    with on_terminal("read", plant.device("flexmax:1"), "9999:int16") as terminal:
        assert terminal.ended() == 3
        assert "parameter does not exist" in terminal.shown
        assert b"\x1b[31m" in terminal.raw
    assert "\x1b" not in multidrop("read", plant.device("flexmax:1"), "9999:int16").err


@pytest.mark.parametrize("where", ["stdin", "stderr"])
def test_half_a_terminal_is_nobody_to_ask(plant: Simulator, where: str) -> None:
    """Questions are asked only where both standard input and standard error are terminals."""
    master, slave = pty.openpty()
    terminal = {"stdin": subprocess.DEVNULL, "stderr": subprocess.PIPE, where: slave}
    done = subprocess.run(
        [COMMAND, "write", plant.device("flexmax:0"), "control_word=6"],
        stdin=terminal["stdin"],
        stdout=subprocess.PIPE,
        stderr=terminal["stderr"],
        timeout=PATIENCE,
        env=environment(),
        check=False,
    )
    os.close(slave)
    os.close(master)
    assert done.returncode == 2
    assert state_of(plant.device("flexmax:0")) == "switch-on disabled"
