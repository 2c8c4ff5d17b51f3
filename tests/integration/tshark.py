"""tshark with multidrop's dissector. Without tshark a test is skipped; .ci/run makes that a failure."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

import multidrop

NEEDED = "MULTIDROP_NEEDS_TSHARK"
LUA = Path(multidrop.__file__).parent / "wireshark" / "multidrop.lua"
INFO = "_ws.col.Info"


def tshark_path() -> str:
    """Where tshark is. Skips the test if it is nowhere, or fails it where it must be."""
    found = shutil.which("tshark")
    if found is None:
        why = "tshark is not installed (make tshark)"
        if os.environ.get(NEEDED):
            pytest.fail(why)
        pytest.skip(why)
    return found


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
    asked = [part for field in ("_ws.lua.error", *fields) for part in ("-e", field)]
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
