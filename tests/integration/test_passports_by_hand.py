"""Passports that people edited, cut or mixed up: refused or skipped by rule, and nobody is left to guess."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from integration.presses import press
from integration.processes import Ran, multidrop, running
from integration.threads import served
from multidrop.catalog import load_profile
from multidrop.io.connection import Target, connect
from multidrop.passports.backup import backup, save
from multidrop.plantfile import load_plant
from multidrop.protocols import slink3
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Pace, SimulatedLine

PRESS = press(
    'model = { at = "8200:uint16", role = "identity", access = "r" }',
    'ramp = { at = "9000:int16", role = "setting", unit = "s", scale = 0.1, minimum = 0, maximum = 100 }',
    'gain = { at = "9001:float32", role = "setting" }',
    'label = { at = "9002:string", role = "setting" }',
)


@dataclass
class Plant:
    """Two presses on a line, and a passport of the first, whose ramp is 0.5 s."""

    folder: Path
    line: SimulatedLine

    def run(self, *arguments: str, status: int = 0) -> Ran:
        ran = multidrop(*arguments, cwd=self.folder)
        assert ran.status == status, ran.err + ran.out
        return ran

    def edited(self, old: str, new: str) -> str:
        """The passport as somebody edited it, by name."""
        text = (self.folder / "a.toml").read_text()
        assert re.search(old, text, re.MULTILINE), old
        (self.folder / "b.toml").write_text(re.sub(old, new, text, count=1, flags=re.MULTILINE))
        return "b.toml"

    def made(self, old: str, new: str) -> str:
        """The same with a checksum that fits, as a program would have made it."""
        text = (self.folder / self.edited(old, new)).read_text().rpartition("[checksum]")[0]
        digest = hashlib.sha256(text.encode()).hexdigest()
        (self.folder / "b.toml").write_text(f'{text}[checksum]\nsha256 = "{digest}"\n')
        return "b.toml"

    def ramp(self) -> float:
        value = self.run("read", "infeed", "ramp", "--json").object["value"]
        assert isinstance(value, float)
        return value


@pytest.fixture
def plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Plant]:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "press.toml").write_text(PRESS)
    profile = load_profile(str(tmp_path / "press.toml"))
    line = SimulatedLine([simulated_device(profile, at) for at in (0, 1)], slink3.decoder)
    with served(line) as place:
        (tmp_path / "multidrop.toml").write_text(
            f'[line.a]\nport = "{place.port}"\ntimeout = 0.2\n'
            + "".join(
                f'[line.a.device.{name}]\nprofile = "press.toml"\naddress = {at}\n'
                for at, name in enumerate(("infeed", "outfeed"))
            )
        )
        infeed = load_plant(tmp_path / "multidrop.toml", load_profile).devices["infeed"]
        with connect(Target(infeed.device, infeed.profile)) as device:
            device.write("ramp", 0.5)
            save(backup(device), tmp_path / "a.toml")
        yield Plant(tmp_path, line)


def test_a_value_that_was_edited_counts_whatever_stands_in_raw(plant: Plant) -> None:
    file = plant.edited(
        '"ramp", role = "setting", value = 0.5', '"ramp", role = "setting", value = 7.0'
    )
    refused = plant.run("restore", file, "infeed", "--yes", status=2)
    assert "edited by hand (--force takes it as it is)" in refused.err
    assert "7 s -> 0.5 s" in plant.run("diff", file, "infeed", "--force", status=1).out
    assert "1 restored" in plant.run("restore", file, "infeed", "--yes", "--force").out
    assert plant.ramp() == 7


def test_a_value_past_the_limits_needs_more_than_an_edited_passport(plant: Plant) -> None:
    file = plant.edited(
        '"ramp", role = "setting", value = 0.5', '"ramp", role = "setting", value = 700.0'
    )
    refused = plant.run("restore", file, "infeed", "--yes", "--force", status=2)
    assert "700 s is out of range for ramp: 0..100 s; nothing was written" in refused.err
    assert plant.ramp() == 0.5
    asked = plant.run("restore", file, "infeed", "--yes", "--force", "--past-limits", status=3)
    assert "9000: refused with code 0012h: above the maximum" in asked.err, "by the device"


@pytest.mark.parametrize("force", [(), ("--force",)])
@pytest.mark.parametrize("size", [60, 400, 620, -90, -3])
def test_a_passport_that_was_cut_short_is_refused_also_by_force(
    plant: Plant, size: int, force: tuple[str, ...]
) -> None:
    (plant.folder / "b.toml").write_text((plant.folder / "a.toml").read_text()[:size])
    for command in (("restore", "b.toml", "infeed", "--yes"), ("diff", "b.toml", "infeed")):
        refused = plant.run(*command, *force, status=2)
        assert "b.toml: " in refused.err
        assert "cut short" in refused.err or size == 60


def test_cut_between_two_lines(plant: Plant) -> None:
    text = (plant.folder / "a.toml").read_text()
    (plant.folder / "b.toml").write_text(text[: text.index('"9001"')])
    refused = plant.run("restore", "b.toml", "infeed", "--yes", "--force", status=2)
    assert "b.toml: the checksum at the end is missing: the file was cut short" in refused.err


@pytest.mark.parametrize("value", ["true", '"7"'])
def test_a_value_of_another_kind_is_refused(plant: Plant, value: str) -> None:
    file = plant.made(
        '"ramp", role = "setting", value = 0.5', f'"ramp", role = "setting", value = {value}'
    )
    refused = plant.run("restore", file, "infeed", "--yes", status=2)
    assert (
        f"the passport does not fit: 9000: {value.title()}, and the device has 0.5".replace(
            '"', "'"
        )
        in refused.err
    )
    assert plant.ramp() == 0.5
    file = plant.made(
        '"label", role = "setting", value = ""', '"label", role = "setting", value = 3'
    )
    plant.run("restore", file, "infeed", "--yes", status=2)


@pytest.mark.parametrize("key", ["0x2328", "ramp", "9000:int16"])
def test_a_point_that_is_not_written_as_a_passport_writes_it_is_skipped(
    plant: Plant, key: str
) -> None:
    """Else one point could stand there twice, with two values."""
    again = f'"{key}" = {{ name = "ramp", role = "setting", value = 9.0, type = "int16", raw = "5A00" }}'
    file = plant.made('^"9000" = .*$', rf"\g<0>\n{again}")
    done = plant.run("restore", file, "infeed", "--yes")
    assert "skipped    1: a passport names this point 9000" in done.out
    assert plant.ramp() == 0.5


def test_another_firmware(plant: Plant) -> None:
    file = plant.made(
        '"model", role = "identity", value = 0', '"model", role = "identity", value = 9'
    )
    refused = plant.run("restore", file, "infeed", "--yes", status=2)
    assert "model (8200): the passport says 9, the device 0" in refused.err


def test_the_undo_passport_replaces_nothing(plant: Plant) -> None:
    before = (plant.folder / "a.toml").read_text()
    plant.run("write", "infeed", "ramp=2")
    for name, why in (
        ("a.toml", "is there already"),
        ("nowhere/u.toml", "there is no folder nowhere"),
        (".", "is a folder"),
    ):
        refused = plant.run("restore", "a.toml", "infeed", "--yes", "--undo", name, status=2)
        assert why in refused.err
        assert refused.out == "", "before anything was read"
    assert (plant.folder / "a.toml").read_text() == before
    assert plant.ramp() == 2


def test_a_backup_replaces_no_other_devices_passport(plant: Plant) -> None:
    before = (plant.folder / "a.toml").read_text()
    refused = plant.run("backup", "outfeed", "-o", "a.toml", status=2)
    assert "a.toml is a passport of press.toml:0@" in refused.err
    assert "; --force replaces it" in refused.err
    assert (plant.folder / "a.toml").read_text() == before
    plant.run("backup", "infeed", "-o", "a.toml")
    plant.run("backup", "outfeed", "-o", "a.toml", "--force")
    assert "address = 1" in (plant.folder / "a.toml").read_text()


def test_a_backup_replaces_nothing_that_is_no_passport(plant: Plant) -> None:
    (plant.folder / "notes.txt").write_text("precious\n")
    refused = plant.run("backup", "infeed", "-o", "notes.txt", status=2)
    assert refused.err == "notes.txt is there and no passport; --force replaces it\n"
    assert (plant.folder / "notes.txt").read_text() == "precious\n"


def test_a_device_that_vanishes_is_said_once(plant: Plant) -> None:
    plant.run("write", "infeed", "ramp=2", "gain=2", "label=two")
    plant.line.ears.append(Vanishing(plant.line))
    done = plant.run("restore", "a.toml", "infeed", "--yes", status=7)
    *verdicts, count = done.out.splitlines()[-4:]
    assert [line.split()[-1] for line in verdicts] == ["unknown", "not-written", "not-written"]
    assert count == "3 skipped, 1 unknown, 2 not-written"
    assert done.err.count("no reply in 3 attempts") == 1, done.err


def test_a_second_name_of_another_type_hides_no_value(plant: Plant) -> None:
    file = plant.folder / "press.toml"
    file.write_text(PRESS + 'other = { at = "9000:float32", role = "setting" }\n')
    made = plant.run("backup", "infeed", "-o", "a.toml")
    assert made.out.startswith("a.toml: 6 points of ")
    assert "could not be read" not in made.out
    plant.run("write", "infeed", "ramp=2")
    assert plant.run("diff", "a.toml", "infeed", status=1).out.endswith("0.5 s -> 2 s\n")


def test_an_interrupted_restore_says_what_is_done_and_how_to_go_on(plant: Plant) -> None:
    plant.run("write", "infeed", "ramp=2", "gain=2", "label=two")
    plant.line.pace = Pace(answer_delay=0.1)
    with running("restore", "a.toml", "infeed", "--yes", cwd=plant.folder) as program:
        program.wait_for("ramp (9000)                      0.5 s   restored")
        done = program.interrupt()
    assert done.status in (7, 130)  # 7: a write was in flight
    left = "1 restored, 2 left: run it again to go on"
    assert left in done.err if done.status == 130 else "not-written" in done.out
    plant.line.pace = Pace()
    assert plant.run("restore", "a.toml", "infeed", "--yes").out.splitlines()[-1] in (
        "2 restored, 1 same, 3 skipped",
        "1 restored, 2 same, 3 skipped",
    )


class Vanishing:
    """A line whose devices vanish when the first write comes."""

    def __init__(self, line: SimulatedLine) -> None:
        self.line = line

    def __call__(self, data: bytes, passed_at: float) -> None:
        if data[5:7] == b"\x27\x00":
            self.line.devices.clear()
