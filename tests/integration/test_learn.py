"""Learning names on a terminal, while somebody changes parameters at the keypad."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from integration.processes import Address, multidrop
from integration.terminal import Terminal, on_terminal
from integration.threads import served
from multidrop.catalog import load_profile
from multidrop.io.connection import connect
from multidrop.points import Role
from multidrop.protocols import slink3, ultra3000
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import SimulatedLine
from multidrop.sim.slink3 import FlexMax

FOUND = """# as discover left it
[profile]
name = "press"
protocol = "slink3"
dialect = "flexmax"

[points]
index_8236 = { at = "8236:int16", source = "discovered", note = "it held 0" }  # ours
index_8511 = { at = "8511:uint16", source = "discovered" }
actual_speed = { at = "std/0x6044.0:int16", role = "measured", access = "r" }
"""


class Talk:
    """What is shown on a terminal, awaited piece by piece, however it comes."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._at = 0
        self.type = terminal.type

    def wait_for(self, part: str) -> None:
        if part not in self._terminal.shown[self._at :]:
            self._terminal.wait_for(part)
        self._at = self._terminal.shown.index(part, self._at) + len(part)


@pytest.fixture
def drive() -> FlexMax:
    return FlexMax(0)


@pytest.fixture
def address(drive: FlexMax) -> Iterator[Address]:
    with served(SimulatedLine([drive], slink3.decoder)) as address:
        yield address


def test_a_parameter_gets_its_name(address: Address, drive: FlexMax, tmp_path: Path) -> None:
    path = tmp_path / "press.toml"
    path.write_text(FOUND)
    feed = drive.parameters.known[(8236, 0)]
    with on_terminal("learn", address.device("flexmax:0"), "-o", str(path)) as terminal:
        talk = Talk(terminal)
        talk.wait_for("then press Enter (q ends)")
        talk.type("\n")
        talk.wait_for("nothing moved")
        talk.wait_for("q ends")
        feed.value = 125
        talk.type("\n")
        talk.wait_for("index_8236 (8236)   0 -> 125")
        talk.wait_for("Name of 8236")
        for answer, question in (
            ("8\n", "begins with no digit"),
            ("actual_speed\n", "Unit"),
            ("\n", "Role"),
            ("\n", "there is a point of this name"),
        ):
            talk.type(answer)
            talk.wait_for(question)
        talk.wait_for("Name of 8236")
        talk.type("feed\n")
        talk.wait_for("Unit")
        talk.type("m/min\n")
        talk.wait_for("Role")
        talk.type("\n")
        talk.wait_for("feed is 8236:int16")
        talk.wait_for("q ends")
        feed.value = 130
        talk.type("\n")
        talk.wait_for("feed (8236)   125 -> 130 m/min")
        talk.wait_for("Name of 8236")
        talk.type("\n")
        talk.wait_for("q ends")
        talk.type("q\n")
        assert terminal.ended() == 0
        assert "1 points learned" in terminal.shown
    assert path.read_text().startswith("# as discover left it")
    points = load_profile(str(path)).points
    assert list(points) == ["feed", "index_8511", "actual_speed"]
    assert (points["feed"].unit, points["feed"].role) == ("m/min", Role.SETTING)
    assert (points["feed"].source, points["feed"].note) == ("learned", "")


def test_what_moves_by_itself_is_not_looked_at(tmp_path: Path) -> None:
    line = SimulatedLine([simulated_device("ultra3000", 0)], ultra3000.decoder, character=0.0001)
    path = tmp_path / "axis.toml"
    with served(line) as address:
        device = address.device("ultra3000:0", timeout=1)
        with connect(device) as axis:
            axis.write("drive_enable", 1)
            axis.write("host_control_mode", 1)
            axis.write("setpoint_velocity", 10000)
        with on_terminal("learn", device, "-o", str(path), "--json") as terminal:
            talk = Talk(terminal)
            talk.wait_for("move by themselves")
            talk.wait_for("q ends")
            with connect(device) as axis:
                axis.write("preset_velocity.3", 500)
            talk.type("\n")
            talk.wait_for("preset_velocity (0x05B.3)   0 counts/s -> 500 counts/s")
            talk.type("jog\n\ncommand\n")
            talk.wait_for('"name": "jog"')
            talk.wait_for("q ends")
            talk.type("q\n")
            assert terminal.ended() == 0
        with connect(f"{path}:0@{address.port},timeout=1") as axis:
            assert axis.read("jog").value == 500
            assert axis.read("preset_velocity.4").value == 0
    assert load_profile(str(path)).points["jog"].role is Role.COMMAND


def test_without_a_terminal_it_says_so(address: Address, tmp_path: Path) -> None:
    ran = multidrop("learn", address.device("flexmax:0"), "-o", "a.toml", cwd=tmp_path)
    assert (ran.status, "it needs a terminal" in ran.err) == (2, True)
    assert not (tmp_path / "a.toml").exists()


def test_a_profile_of_another_protocol(address: Address, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('[profile]\nname = "a"\nprotocol = "datalink"\n')
    ran = multidrop("learn", address.device("flexmax:0"), "-o", "a.toml", cwd=tmp_path)
    assert (ran.status, "is a profile of datalink" in ran.err) == (2, True)


def test_nothing_is_known(address: Address, tmp_path: Path) -> None:
    ran = multidrop("learn", address.device("slink3:0"), "-o", "a.toml", cwd=tmp_path)
    assert ran.status == 2
    assert f"multidrop discover {address.device('slink3:0')} -o a.toml finds points" in ran.err


def test_ctrl_c(address: Address, tmp_path: Path) -> None:
    with on_terminal(
        "learn", address.device("flexmax:0"), "-o", str(tmp_path / "a.toml")
    ) as terminal:
        terminal.wait_for("q ends")
        assert terminal.interrupt() == 130
