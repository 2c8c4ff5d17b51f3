"""The audit log: one line a write, append only, and no write without it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from multidrop.errors import UsageError
from multidrop.io.audit import AuditLog, default_path, jsonable
from multidrop.points import Point, Role, Sample
from multidrop.profile import PointDescription
from multidrop.writing import Outcome, Written

SPEED = PointDescription("speed", "8237:int16", Role.SETPOINT, unit="rpm", scale=0.5)


def lines(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_a_write(tmp_path: Path) -> None:
    log = AuditLog(tmp_path / "deep" / "audit.jsonl", origin="tests")
    point = Point("8237", "int16", SPEED)
    old, found = Sample(10, "int16", b"\x0a\0"), Sample(20, "int16", b"\x14\0")
    log.check()
    log.written("flexmax:0@x", Written(point, 10.0, Outcome.CONFIRMED, old, found))
    log.written("flexmax:0@x", Written(Point("1"), b"\xff", Outcome.UNKNOWN))
    first, second = lines(tmp_path / "deep" / "audit.jsonl")
    assert first["from"] == "tests"
    assert first["device"] == "flexmax:0@x"
    assert (first["point"], first["name"]) == ("8237", "speed")
    assert (first["old"], first["asked"], first["found"]) == (5.0, 10.0, 10.0)
    assert (second["old"], second["asked"], second["outcome"]) == (None, "ff", "unknown")
    assert str(first["time"]) <= str(second["time"])


def test_what_is_there_stays(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    path.write_text('{"old": "line"}\n')
    log = AuditLog(path, origin="tests")
    log.check()
    log.append("d", "p", outcome="confirmed", answer={"response": 0})
    assert lines(path)[0] == {"old": "line"}
    assert lines(path)[1]["answer"] == {"response": 0}
    assert lines(path)[1]["asked"] is None


def test_a_log_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    unwritable = tmp_path / "file" / "audit.jsonl"
    with pytest.raises(UsageError, match=r"audit.jsonl cannot be written .* use --force"):
        AuditLog(unwritable, origin="tests").check()
    with pytest.raises(OSError):
        AuditLog(unwritable, origin="tests").append("d", "p")
    forced = AuditLog(unwritable, origin="tests", force=True)
    forced.check()
    forced.append("d", "p")


def test_where_it_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MULTIDROP_AUDIT", str(tmp_path / "here.jsonl"))
    assert default_path() == tmp_path / "here.jsonl"
    assert AuditLog(origin="tests").path == tmp_path / "here.jsonl"
    monkeypatch.delenv("MULTIDROP_AUDIT")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_path().name == "audit.jsonl"
    assert tmp_path in default_path().parents


def test_what_json_has_not() -> None:
    assert jsonable(float("nan")) is None
    assert jsonable(float("-inf")) is None
    assert jsonable(b"\x01\xff") == "01ff"
    assert jsonable(1.5) == 1.5
    assert jsonable("text") == "text"
    assert jsonable(True) is True
