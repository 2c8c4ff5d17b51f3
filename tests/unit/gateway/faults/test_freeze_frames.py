"""Freeze-frames on disk: whole, in order, bounded, and found again."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from multidrop.errors import UsageError
from multidrop.gateway.faults.freeze_frames import FreezeFrame, FreezeFrames


def frame(device: str, second: int) -> FreezeFrame:
    time = f"2026-11-22T02:31:{second:02}.000000Z"
    return {"v": 1, "device": device, "time": time, "cleared": None}


def test_they_are_found_again_newest_first(tmp_path: Path) -> None:
    kept = FreezeFrames(tmp_path / "faults")
    assert (kept.names("infeed"), kept.newest("infeed")) == ([], None)
    for second in (5, 7, 6):
        kept.save(frame("infeed", second))
    kept.save(frame("press", 9))
    assert kept.names("infeed") == [f"2026-11-22T02-31-{second:02}.000000Z" for second in (7, 6, 5)]
    assert kept.newest("infeed") == frame("infeed", 7)
    assert kept.load("infeed", kept.names("infeed")[2]) == frame("infeed", 5)


def test_one_that_is_saved_again_replaces_itself(tmp_path: Path) -> None:
    kept = FreezeFrames(tmp_path)
    kept.save(frame("infeed", 5))
    kept.save({**frame("infeed", 5), "cleared": "2026-11-22T03:00:00.000000Z"})
    assert len(kept.names("infeed")) == 1
    newest = kept.newest("infeed")
    assert newest is not None
    assert newest["cleared"] == "2026-11-22T03:00:00.000000Z"
    assert len(list((tmp_path / "infeed").iterdir())) == 1


def test_the_oldest_go(tmp_path: Path) -> None:
    kept = FreezeFrames(tmp_path, keep=3)
    for second in range(6):
        kept.save(frame("infeed", second))
    assert [name[17:19] for name in kept.names("infeed")] == ["05", "04", "03"]


@pytest.mark.parametrize("name", ["../../etc", "..", "a/b", ".", "größe", "a b", "\x00", "C:\\x"])
def test_no_name_of_a_device_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    kept = FreezeFrames(tmp_path / "faults")
    kept.save(frame(name, 1))
    (found,) = (path for path in tmp_path.rglob("*.json"))
    assert found.parent.parent == tmp_path / "faults"
    assert kept.newest(name) == frame(name, 1)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"v": 2}', "\xff"])
def test_a_file_that_is_none_is_named(tmp_path: Path, text: str) -> None:
    kept = FreezeFrames(tmp_path)
    kept.save(frame("infeed", 1))
    (name,) = kept.names("infeed")
    (tmp_path / "infeed" / f"{name}.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(UsageError, match="is no freeze-frame"):
        kept.load("infeed", name)
    assert kept.newest("infeed") is None


def test_one_that_does_not_exist(tmp_path: Path) -> None:
    kept = FreezeFrames(tmp_path)
    (tmp_path / "secret.json").write_text('{"v": 1}')
    for name in ("2026", "../secret"):
        with pytest.raises(UsageError, match="infeed has no freeze-frame"):
            kept.load("infeed", name)


def test_a_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="freeze-frames cannot be kept in"):
        FreezeFrames(tmp_path / "file" / "faults").check()
    if os.geteuid():
        (tmp_path / "read-only").mkdir(0o500)
        with pytest.raises(UsageError, match="not writable"):
            FreezeFrames(tmp_path / "read-only").check()
    FreezeFrames(tmp_path / "new" / "faults").check()
    assert (tmp_path / "new" / "faults").is_dir()
