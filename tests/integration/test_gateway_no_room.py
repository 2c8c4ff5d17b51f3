"""A gateway that is started on a disk without room: no fault of its plant file, so a service tries again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from integration.counting import CountingLine, counting, stop
from integration.processes import multidrop, running
from integration.test_campaigns_full import small

NOBODY: Any = None
"""No program is needed to fill a file system."""


@pytest.mark.parametrize("used", [False, True], ids=["new", "used"])
@pytest.mark.parametrize(
    ("table", "file"),
    [
        ('[mqtt]\nhost = "127.0.0.1"\nport = 1\noutbox = "mqtt.db"\n', "mqtt.db"),
        ("[history]\n", "history.db"),
        ('[modbus]\nlisten = "127.0.0.1:0"\n', "registers.csv"),
    ],
    ids=["mqtt", "history", "modbus"],
)
def test_it_ends_with_5_and_runs_once_there_is_room(
    tmp_path: Path, table: str, file: str, used: bool
) -> None:
    """With files that are there history and Modbus do not even end: they wait for room."""
    line = CountingLine("press")
    with small(tmp_path) as disk, counting(line):
        (disk.folder / "multidrop.toml").write_text(line.toml + table)
        if used:
            with running("run", cwd=disk.folder) as program:
                line.wait_for_more(5)
        disk.fill(NOBODY)
        assert multidrop("check", cwd=disk.folder).status == 0
        if used and file != "mqtt.db":
            with running("run", cwd=disk.folder) as program:
                line.wait_for_more(30)
                stop(program)
        else:
            ended = multidrop("run", cwd=disk.folder)
            assert ended.status == 5, ended.err
            assert file in ended.err
        disk.empty(NOBODY)
        with running("run", cwd=disk.folder) as program:
            line.wait_for_more(10)
            stop(program)
