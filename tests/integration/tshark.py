"""tshark with multidrop's dissector. Without tshark a test is skipped."""

from __future__ import annotations

import functools
import os
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

from programs import program

import multidrop

LUA = Path(multidrop.__file__).parent / "wireshark" / "multidrop.lua"
INFO = "info"
"""The line that stands in the list of packets; tshark 4.2 spells its field differently."""


def tshark_path() -> str:
    return program("tshark", "make tshark")


@functools.cache
def info_field() -> str:
    """What tshark calls the column."""
    said = subprocess.run([tshark_path(), "--version"], capture_output=True, text=True, check=True)
    version = re.search(r"\d+\.\d+", said.stdout)
    assert version is not None
    newer = tuple(map(int, version[0].split("."))) >= (4, 2)
    return "_ws.col.info" if newer else "_ws.col.Info"


def tshark(*arguments: str, home: Path) -> str:
    """What tshark prints; `home` keeps a user's own settings and plugins out. A Lua error fails."""
    done = subprocess.run(
        [tshark_path(), *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=60,
        env={**os.environ, "HOME": str(home), "XDG_CONFIG_HOME": str(home), "LC_ALL": "C.UTF-8"},
        check=False,
    )
    out, err = done.stdout.decode(), done.stderr.decode()
    assert done.returncode == 0, err
    assert "Lua" not in err, err
    return out


def dissected(
    capture: Path, fields: Sequence[str], *, home: Path, passes: int = 2
) -> list[dict[str, str]]:
    """These fields of every packet; "" for one that it has not, the first where it has several."""
    names = ["_ws.lua.error", *(info_field() if field == INFO else field for field in fields)]
    asked = [part for name in names for part in ("-e", name)]
    options = ["-T", "fields", "-E", "separator=/t", "-E", "occurrence=f", *asked]
    twice = ["-2", "-R", "frame"] if passes == 2 else []  # with a filter fields are there at once
    script = ["-X", f"lua_script:{LUA}"]
    out = tshark("-r", str(capture), *twice, *script, *options, home=home)
    rows = []
    for line in out.splitlines():
        error, *values = line.split("\t")
        assert error == "", line
        rows.append(dict(zip(fields, values, strict=True)))
    return rows
