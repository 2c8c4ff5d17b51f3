"""A folder of passports: whose each is, in which order, and what is damaged, foreign or in the way."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from multidrop.errors import UsageError
from multidrop.io.connection import Target
from multidrop.naming import parse_device
from multidrop.passports.backup import save
from multidrop.passports.folder import LARGEST, Index, Listed, Passports, save_as_new
from multidrop.passports.passport import Entry, Passport
from multidrop.points import Role

NOW = datetime(2026, 11, 22, 2, 31, 7, tzinfo=UTC)
AXIS = Target(parse_device("ultra3000:0@/dev/ttyUSB0"))
KP = Entry("0x011", "kp", Role.SETTING, 4.0, None, "uint16", "0200")
NOBODY: frozenset[str] = frozenset()


def passport(device: str = "ultra3000:0@/dev/ttyUSB0", days: int = 0) -> Passport:
    profile, _, address = device.partition("@")[0].partition(":")
    return Passport(
        device, profile, "1", int(address), 38400, "8N1", NOW + timedelta(days), "0.1.0",
        {"0x011": KP},
    )  # fmt: skip


def names(folder: Path) -> list[str]:
    return [item.path.name for item in Index(folder).listed()]


def test_a_new_one_is_named_after_device_and_time(tmp_path: Path) -> None:
    assert save_as_new(passport(), "axis", tmp_path).name == "axis-20261122T023107Z.passport.toml"
    again = save_as_new(passport(), "axis", tmp_path)
    assert again.name == "axis-20261122T023107Z-2.passport.toml", "what is there stays"
    assert len(Passports.of(tmp_path).kept) == 2


@pytest.mark.parametrize("name", ["../axis", "/axis", "a/b", "a\\b", "..", ".", "CON:", "a\nb"])
def test_no_name_of_a_device_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "kept"
    folder.mkdir()
    made = save_as_new(passport(), name, folder)
    assert made.parent == folder
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    (listed,) = Index(folder).listed()
    assert listed.is_of(name, AXIS, NOBODY)
    made.write_text("x")  # then its name tells whose it is
    (damaged,) = Index(folder).listed()
    assert damaged.is_of(name, AXIS, NOBODY)


def test_the_newest_first_and_read_again_when_changed(tmp_path: Path) -> None:
    for days in (1, 3, 2):
        save(passport(days=days), tmp_path / f"{days}.toml")
    index = Index(tmp_path)
    assert [item.path.stem for item in index.listed()] == ["3", "2", "1"]
    first = index.listed()[0]
    assert (first.device, first.points, first.unreadable, first.damage) == (
        "ultra3000:0@/dev/ttyUSB0", 1, 0, None,
    )  # fmt: skip
    save(passport(days=9), tmp_path / "1.toml")
    (tmp_path / "3.toml").unlink()
    assert [item.path.stem for item in index.listed()] == ["1", "2"]


def test_those_of_one_second_in_the_order_in_which_they_were_made(tmp_path: Path) -> None:
    made = [save_as_new(passport(), "axis", tmp_path) for _ in range(11)]
    assert [item.path for item in Index(tmp_path).listed()] == made[::-1]
    latest = Passports.of(tmp_path).latest(AXIS)
    assert latest is not None
    assert latest.path == made[-1]


def test_whose_it_is(tmp_path: Path) -> None:
    """Its own name goes first; another port's counts unless that is another device of the plant."""
    save(passport(), tmp_path / "own.toml")
    save(passport("ultra3000:0@/dev/ttyUSB9"), tmp_path / "moved.toml")
    save(passport("ultra3000:1@/dev/ttyUSB0"), tmp_path / "address.toml")
    save(passport("ax-v:0@/dev/ttyUSB0"), tmp_path / "model.toml")
    listed = Index(tmp_path).listed()

    def of_axis(others: frozenset[str]) -> set[str]:
        return {item.path.stem for item in listed if item.is_of("axis", AXIS, others)}

    assert of_axis(NOBODY) == {"own", "moved"}
    assert of_axis(frozenset({"ultra3000:0@/dev/ttyUSB9"})) == {"own"}


def test_what_is_damaged_and_what_is_something_else(tmp_path: Path) -> None:
    text = passport().to_text()
    (tmp_path / "edited.toml").write_text(text.replace("value = 4.0", "value = 5.0"))
    (tmp_path / "axis.passport.toml").write_text(text[:200])
    (tmp_path / "axle.passport.toml").write_bytes(b"\xff\xfe")
    (tmp_path / "tokens.toml").write_text('[ann]\nsha256 = "00"\n')
    (tmp_path / "notes.toml").write_text("not toml at all")
    (tmp_path / ".axis.passport.toml.1.unfinished").write_text(text)
    (tmp_path / ".hidden.toml").write_text(text)
    (tmp_path / "readme.txt").write_text(text)
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / os.fsdecode(b"\xff.toml")).write_text(text)
    (tmp_path / "new\nline.toml").write_text(text)
    (tmp_path / "nowhere.toml").symlink_to(tmp_path / "gone")
    with (tmp_path / "large.passport.toml").open("wb") as file:
        file.truncate(LARGEST + 1)
    found = {item.path.name: item for item in Index(tmp_path).listed()}
    assert set(found) == {
        "edited.toml",
        "axis.passport.toml",
        "axle.passport.toml",
        "large.passport.toml",
    }
    assert "its checksum does not fit" in str(found["edited.toml"].damage)
    assert found["edited.toml"].is_of("axis", AXIS, NOBODY)
    for name, reason in (
        ("axis", "cut short"),
        ("axle", "not UTF-8"),
        ("large", "larger than"),
    ):
        item = found[f"{name}.passport.toml"]
        assert (item.time, item.device) == (None, "")
        assert reason in str(item.damage)
    assert found["axis.passport.toml"].is_of("axis", AXIS, NOBODY)
    assert not found["axle.passport.toml"].is_of("axis", AXIS, NOBODY)


def test_another_devices_name_that_begins_alike() -> None:
    damaged = Listed(Path("axis-2-20261122T023107Z.passport.toml"), damage="cut short")
    assert damaged.is_of("axis-2", AXIS, NOBODY)
    assert not damaged.is_of("axis", AXIS, NOBODY)
    other = replace(damaged, path=Path("axis-spare-20261122T023107Z.passport.toml"))
    assert not other.is_of("axis", AXIS, NOBODY)


def test_a_folder_that_is_away(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Index(tmp_path / "nowhere").listed()
    with pytest.raises(UsageError, match="there is no folder"):
        Passports.of(tmp_path / "nowhere")
