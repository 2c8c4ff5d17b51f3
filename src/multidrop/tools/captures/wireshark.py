"""Puts the dissector and the extcap where Wireshark looks for what a user adds."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from multidrop.errors import UsageError

DISSECTOR = Path(__file__).parents[2] / "wireshark" / "multidrop.lua"
OURS = "multidrop"
"""A file without this word in it is somebody else's."""

PATIENCE = 30.0  # s for Wireshark to name its folders


@dataclass(frozen=True, slots=True)
class Folders:
    """Where a user's own Lua scripts and extcap programs go; `found` is the program that said so."""

    lua: Path
    extcap: Path
    found: str | None = None

    @property
    def files(self) -> tuple[Path, Path]:
        """The dissector and the extcap there."""
        return self.lua / "multidrop.lua", self.extcap / "multidrop"


def folders() -> Folders:
    """The folders that Wireshark names, or its usual ones where there is none."""
    for name in ("tshark", "wireshark"):
        program = shutil.which(name)
        if program is not None:
            said = _said([program, "-G", "folders"])
            if said:
                return _named(said, program)
    return _named({}, None)


def _said(command: list[str]) -> dict[str, str]:
    """What a program says as `name: value`; nothing where it fails."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return {}
    pairs = (line.partition(":") for line in done.stdout.splitlines())
    return {name.strip().lower(): value.strip() for name, _, value in pairs if value.strip()}


def _named(said: dict[str, str], program: str | None) -> Folders:
    """Before Wireshark 4.2 an extcap of one's own is beside the settings, and no folder is named."""
    library = Path("~/.local/lib/wireshark").expanduser()
    lua = Path(said.get("personal lua plugins", library / "plugins"))
    extcap = library / "extcap"
    if "personal extcap path" in said:
        extcap = Path(said["personal extcap path"])
    elif "personal configuration" in said:
        extcap = Path(said["personal configuration"]) / "extcap"
    return Folders(lua, extcap, program)


def extcap_script() -> str:
    """The program that Wireshark runs: this Python with this multidrop."""
    return (
        "#!/bin/sh\n"
        "# Lets Wireshark listen to serial lines; written by multidrop wireshark --install.\n"
        f'exec {shlex.quote(sys.executable)} -m multidrop extcap "$@"\n'
    )


def install(where: Folders) -> None:
    """Write both files. Raises `UsageError` where a file there is somebody else's, or cannot be."""
    dissector, extcap = where.files
    contents = {dissector: DISSECTOR.read_text(encoding="utf-8"), extcap: extcap_script()}
    try:
        for path in contents:
            if path.exists() and OURS not in path.read_text(encoding="utf-8", errors="replace"):
                raise UsageError(f"{path} is there and not of multidrop; it was left as it is")
        for path, text in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        os.chmod(extcap, 0o755)
    except OSError as error:
        raise UsageError(f"cannot write {error.filename}: {error.strerror}") from None
