"""Where a command's output goes: nowhere, onto a full disk, without colours, to a narrow terminal."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from integration.processes import COMMAND, PATIENCE, Address, Simulator, environment, multidrop
from integration.terminal import on_terminal

needs_dev_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is of Linux")


def in_shell(text: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`"$@"` is the command."""
    return subprocess.run(
        ["sh", "-c", text, "sh", COMMAND, *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        env=environment(),
        check=False,
    )


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_stream_that_is_closed(plant: Simulator, closed: str) -> None:
    """As a command is started by some services: what it does is done all the same."""
    done = in_shell(f'"$@" {closed}', "read", plant.device("ax-v:2"), "1009")
    assert done.returncode == 0
    assert done.stderr == ""
    assert ("125" in done.stdout) == (">&-" not in closed.replace("2>&-", ""))


def test_a_line_is_never_opened_in_place_of_a_closed_stream(
    plant: Simulator, tmp_path: Path
) -> None:
    """The first file that a program opens takes the lowest number that is free: 1, say."""
    capture = tmp_path / "line.pcapng"
    done = in_shell('"$@" >&-', "read", plant.device("ax-v:2"), "1009", "--capture", str(capture))
    assert done.returncode == 0
    assert b"125" not in capture.read_bytes()


@needs_dev_full
def test_output_that_nothing_takes(plant: Simulator) -> None:
    done = in_shell('"$@" >/dev/full', "read", plant.device("ax-v:2"), "1009")
    assert done.returncode == 1
    assert done.stderr == "the output could not be written: No space left on device\n"


@needs_dev_full
def test_a_write_that_cannot_be_recorded_once_it_is_done(fresh: Address) -> None:
    """The disk filled up behind the check: what became of the write is said all the same."""
    done = multidrop(
        "write", fresh.device("ax-v:2"), "1111=7", "1009=8", MULTIDROP_AUDIT="/dev/full"
    )
    assert done.status == 1
    first, second = done.out.splitlines()
    assert first == "ipa_1111 (1111)                  100 -> 7   confirmed"
    assert second == "ipa_1009 (1009)                  8   not-sent"
    assert "/dev/full" in done.err
    assert "No space left on device" in done.err
    assert '"asked": 7' in done.err  # the line that the log has not
    assert "125" in multidrop("read", fresh.device("ax-v:2"), "1009").out


@pytest.mark.parametrize(("no_color", "red"), [("1", False), ("", True)])
def test_no_color(plant: Simulator, no_color: str, red: bool) -> None:
    with on_terminal("read", plant.device("ax-v:2"), "nothing", NO_COLOR=no_color) as terminal:
        assert terminal.ended() == 2
    assert (b"\x1b[31m" in terminal.raw) == red


def test_watch_on_a_narrow_terminal_shows_the_values(fresh: Address) -> None:
    device = fresh.device("ax-v:2")
    with on_terminal("watch", device, "1009", "--every", "0.05", COLUMNS="40") as terminal:
        shown = terminal.wait_for("125")
        assert "ipa_1009 (1009)" in shown
        assert terminal.interrupt() == 130


def test_watch_on_a_terminal_that_cannot_go_back(fresh: Address) -> None:
    device = fresh.device("ax-v:2")
    with on_terminal("watch", device, "1009", "--every", "0.05", TERM="dumb") as terminal:
        terminal.wait_for("125")
        assert terminal.interrupt() == 130


def test_a_table_on_a_narrow_terminal_keeps_its_names(tmp_path: Path) -> None:
    with on_terminal("points", "flexmax", "speed", COLUMNS="40") as terminal:
        assert terminal.ended() == 0
    assert "speed_setpoint" in terminal.shown
    assert "std/0x6042.0:int16" in terminal.shown


PLANT = """[line.press]
port = "PORT"
[line.press.device.winder]
profile = "ax-v"
address = 2
[line.press.device.winder.points]
tension = { at = "1009:int16", unit = "\u03a9\u00b7m" }
"""


@pytest.fixture
def odd_unit(tmp_path: Path, plant: Simulator) -> Path:
    """A folder with a plant file that has a point in units of `\u03a9\u00b7m`, and a capture of it."""
    (tmp_path / "multidrop.toml").write_text(PLANT.replace("PORT", plant.port), encoding="utf-8")
    assert multidrop("read", "winder", "tension", "--capture", "c", cwd=tmp_path).status == 0
    return tmp_path


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8"])
@pytest.mark.parametrize("command", ["read winder tension", "decode c", "decode c --csv"])
def test_a_stream_that_has_not_every_letter(odd_unit: Path, encoding: str, command: str) -> None:
    ran = subprocess.run(
        [COMMAND, *command.split()],
        capture_output=True,
        cwd=odd_unit,
        timeout=PATIENCE,
        env=environment(PYTHONIOENCODING=encoding),
        check=False,
    )
    assert ran.returncode == 0
    assert b"125" in ran.stdout
    assert b"Traceback" not in ran.stderr


@pytest.mark.parametrize("command", ["read winder tension", "decode c", "check"])
def test_json_is_utf_8_everywhere(odd_unit: Path, command: str) -> None:
    ran = subprocess.run(
        [COMMAND, *command.split(), "--json"],
        capture_output=True,
        cwd=odd_unit,
        timeout=PATIENCE,
        env=environment(PYTHONIOENCODING="cp1252"),
        check=False,
    )
    (line,) = ran.stdout.decode("utf-8").splitlines()
    assert json.loads(line).get("unit") == (None if command == "check" else "\u03a9\u00b7m")


def test_a_name_that_the_locale_has_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plant: Simulator
) -> None:
    for name, value in (("LC_ALL", "C"), ("PYTHONUTF8", "0"), ("PYTHONCOERCECLOCALE", "0")):
        monkeypatch.setenv(name, value)
    asked = ("backup", plant.device("ax-v:2"), "-o", "w\u00f6.toml")
    assert multidrop(*asked, "--json", cwd=tmp_path).object["file"] == "w\u00f6.toml"
    assert multidrop(*asked, cwd=tmp_path).status == 0
    assert (tmp_path / "w\u00f6.toml").exists()


def test_a_locale_that_knows_no_bars(monkeypatch: pytest.MonkeyPatch, plant: Simulator) -> None:
    for name, value in (("LC_ALL", "C"), ("PYTHONUTF8", "0"), ("PYTHONCOERCECLOCALE", "0")):
        monkeypatch.setenv(name, value)
    assert "speed_setpoint" in multidrop("points", "flexmax").out
    assert "125" in multidrop("read", plant.device("ax-v:2"), "1009").out
