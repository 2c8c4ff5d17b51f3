"""Streams that are open for days: who may no longer ask is told no more."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from integration.gateways import gateway


@pytest.mark.parametrize("path", ["/api/events", "/api/lines/press/frames"])
def test_a_token_that_is_taken_out_ends_its_streams(tmp_path: Path, path: str) -> None:
    with gateway(tmp_path) as running, running.client.stream(path, running.reader) as events:
        next(events)
        tokens = tmp_path / "tokens.toml"
        before, _, _ = tokens.read_text().partition("[reader]")
        tokens.write_text(before)
        since = time.monotonic()
        for _ in events:
            assert time.monotonic() - since < 5
        assert running.client.get("/health").status == 200
        assert "Traceback" not in "".join(running.program.err)
