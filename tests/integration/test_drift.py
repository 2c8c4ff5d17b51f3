"""A plant against its passports, through real sockets."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path

import pytest

from integration.processes import multidrop, running
from integration.threads import served, simulated
from multidrop.io.connection import Target, connect
from multidrop.naming import parse_device
from multidrop.passports.backup import backup, save
from multidrop.passports.drift import look
from multidrop.passports.folder import Passports
from multidrop.protocols import ultra3000
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import SimulatedLine


@dataclass
class Site:
    """A plant of an axis, an AX-V and a device that nobody has switched on."""

    folder: Path
    axis: str
    line: SimulatedLine

    def run(self, *arguments: str, status: int) -> str:
        ran = multidrop("watch-drift", "plant.toml", *arguments, cwd=self.folder)
        assert ran.status == status, ran.err + ran.out
        return ran.out + ran.err


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with contextlib.ExitStack() as stack:
        line = SimulatedLine(
            [simulated_device("ultra3000", 0)], ultra3000.decoder, character=0.0001
        )
        axis = stack.enter_context(served(line))
        winder = stack.enter_context(simulated("ax-v:2"))
        (tmp_path / "plant.toml").write_text(
            f'[line.a]\nport = "{axis.port}"\ntimeout = 1\n'
            '[line.a.device.axis]\nprofile = "ultra3000"\naddress = 0\n'
            f'[line.b]\nport = "{winder.port}"\ntimeout = 0.1\n'
            '[line.b.device.spare]\nprofile = "ax-v"\naddress = 7\n'
            '[line.b.device.winder]\nprofile = "ax-v"\naddress = 2\n'
        )
        yield Site(tmp_path, axis.device("ultra3000:0", timeout=1), line)


def test_what_was_changed_at_the_keypad(site: Site) -> None:
    missing = site.run(status=2)
    assert "there is no folder passports with passports" in missing

    (site.folder / "passports").mkdir()
    without = site.run(status=4)
    assert without.count("passports has no passport of it") == 2

    first = site.run("--save", status=4)
    assert "has no passport of it" not in first
    assert "spare: no reply" in first
    files = {path.name.partition("-")[0] for path in (site.folder / "passports").iterdir()}
    assert files == {"axis", "winder"}
    assert site.run(status=4).count("spare") == 1, "and nothing else"

    with connect(site.axis) as axis:
        axis.write("kp", 6)
    found = site.run(status=1)
    assert "axis: kp (0x011)   4 -> 6   since " in found
    assert "spare: no reply" in found, "it does not stop the others, nor they it"

    saved = site.run("--save", status=1)
    assert "axis: passports/axis-" in saved
    assert "winder: passports" not in saved, "nothing of it differs"
    assert "kp" not in site.run(status=4), "the new passport counts"


def test_json_and_what_is_no_passport(site: Site) -> None:
    site.run("--save", "--passports", "kept", status=4)
    (site.folder / "kept" / "broken.toml").write_text("passport = 1\n")
    with connect(site.axis) as axis:
        axis.write("position_error_limit", 9000)
    ran = multidrop("watch-drift", "plant.toml", "--passports", "kept", "--json", cwd=site.folder)
    assert ran.status == 1
    assert "not used: kept/broken.toml: the checksum at the end is missing" in ran.err
    changed, silent = ran.objects
    assert (changed["device"], changed["name"]) == ("axis", "position_error_limit")
    assert (changed["before"], changed["after"], changed["unit"]) == (8000, 9000, "counts")
    assert changed["passport"].startswith("kept/axis-")
    assert (silent["device"], silent["error"]["kind"]) == ("spare", "no-reply")


def test_again_and_again_says_each_change_once(site: Site) -> None:
    site.run("--save", status=4)
    arguments = ("watch-drift", "plant.toml", "--every", "0.1")
    with running(*arguments, cwd=site.folder) as program:
        program.wait_for("spare: no reply")
        with connect(site.axis) as axis:
            axis.write("kp", 6)
        program.wait_for("axis: kp (0x011)   4 -> 6")
        with connect(site.axis) as axis:
            axis.write("ki", 3)
        program.wait_for("axis: ki (0x012)   0 -> 3")
        ended = program.interrupt()
    assert ended.status == 130
    assert ended.out.count("kp") == 1
    assert ended.err.count("spare") == 1


def test_a_silence_makes_no_change_new(site: Site) -> None:
    """What was said before it is not said again when the device is back; its next silence is."""
    file = site.folder / "plant.toml"
    file.write_text(file.read_text().replace("timeout = 1\n", "timeout = 0.4\n"))
    site.run("--save", status=4)
    arguments = ("watch-drift", "plant.toml", "--every", "0.1")
    with running(*arguments, cwd=site.folder) as program:
        program.wait_for("spare: no reply")
        with connect(site.axis) as axis:
            axis.write("kp", 6)
        program.wait_for("axis: kp (0x011)   4 -> 6")
        for point, value in (("ki", 3), ("position_error_limit", 9000)):
            device = site.line.devices.pop()
            program.wait_for("axis: no reply")
            site.line.devices.append(device)
            with connect(site.axis) as axis:
                axis.write(point, value)
            program.wait_for(f"axis: {point} (")
        ended = program.interrupt()
    assert [line.split()[1] for line in ended.out.splitlines()] == [
        "kp",
        "ki",
        "position_error_limit",
    ]
    assert ended.err.count("axis: no reply") == 2


def test_a_plant_without_devices(tmp_path: Path) -> None:
    (tmp_path / "plant.toml").write_text("")
    (tmp_path / "passports").mkdir()
    ran = multidrop("watch-drift", "plant.toml", cwd=tmp_path)
    assert (ran.status, "has no devices" in ran.err) == (2, True)


def test_which_passport_counts_and_what_it_lacks(tmp_path: Path) -> None:
    """The newest of the same name goes before a newer one of another port; a point that is not in it is no drift."""
    with simulated("ax-v:2") as place:
        target = Target(parse_device(place.device("ax-v:2", timeout=1)))
        with connect(target) as drive:
            made = backup(drive)
        day = timedelta(days=1)
        elsewhere = replace(made, device="ax-v:2@/dev/ttyUSB9", time=made.time + day)
        without = dict(list(made.points.items())[:1])
        older = replace(made, time=made.time - day)
        for name, passport in (
            ("a", elsewhere),
            ("b", replace(made, points=without)),
            ("c", older),
        ):
            save(passport, tmp_path / f"{name}.passport.toml")
        found = look("winder", target, Passports.of(tmp_path))
        assert found.kept is not None
        assert (found.kept.path.name, found.differences, found.error) == (
            "b.passport.toml",
            [],
            None,
        )
        (tmp_path / "b.passport.toml").unlink()
        (tmp_path / "c.passport.toml").unlink()
        found = look("winder", target, Passports.of(tmp_path))
        assert found.kept is not None
        assert found.kept.path.name == "a.passport.toml"
