"""Command lines in this process: quick, and without a terminal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from multidrop.cli.main import run

CommandLine = Callable[..., tuple[int, str, str]]


@pytest.fixture
def command_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> CommandLine:
    """`command_line("read", ...)` gives exit status, standard output and standard error."""
    monkeypatch.setenv("MULTIDROP_AUDIT", str(tmp_path / "audit.jsonl"))
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        status = run(arguments)
        out, err = capsys.readouterr()
        return status, out, err

    return call
