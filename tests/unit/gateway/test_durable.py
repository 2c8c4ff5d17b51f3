"""Which transactions wait for the disk."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from multidrop.gateway.durable import Durable

NORMAL, FULL = 1, 2


def test_one_a_second_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    with closing(sqlite3.connect(tmp_path / "x.db", isolation_level=None)) as file:
        chosen = Durable(file)
        found = []
        for _ in range(6):
            chosen.choose()
            found += file.execute("PRAGMA synchronous").fetchone()
            now += 0.4
    assert found == [FULL, NORMAL, NORMAL, FULL, NORMAL, NORMAL]
