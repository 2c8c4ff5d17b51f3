"""Where files and links may be made: told before any work, and by the errors that say so."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from typing import Any

import pytest

from multidrop.errors import PortError, UsageError
from multidrop.io.listen import listen
from multidrop.io.text_file import check_place, write_whole
from multidrop.naming import parse_device


def test_a_place_for_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "press.toml"
    check_place(path)
    write_whole("x", path)
    check_place(path, force=True)
    for wrong, why in (
        (path, "there already; --force replaces it"),
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "x", "there is no folder"),
    ):
        with pytest.raises(UsageError, match=why):
            check_place(wrong)
    monkeypatch.setattr(os, "access", lambda *_: False)  # whoever runs this may be root
    with pytest.raises(UsageError, match=r"new.toml: nothing may be written into "):
        check_place(tmp_path / "new.toml")


def test_a_link_in_a_folder_that_nobody_may_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(self: Path) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "is_symlink", forbidden)

    def nobody(caller: Any) -> Any:
        raise AssertionError("nobody can call")

    with pytest.raises(PortError, match=r"cannot make .*drive: Permission denied"):
        asyncio.run(listen(f"pty:{tmp_path / 'drive'}", nobody))


def test_a_port_that_the_system_keeps_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    async def forbidden(*arguments: Any) -> Any:
        raise PermissionError(13, "Permission denied")

    async def main() -> None:
        monkeypatch.setattr(asyncio.get_running_loop(), "create_server", forbidden)
        await listen("tcp://127.0.0.1:80", lambda caller: None)  # type: ignore[arg-type, return-value]

    with pytest.raises(PortError, match=r"cannot listen on .*:80: .*below 1024 are the system's"):
        asyncio.run(main())


def test_a_line_for_a_broadcast() -> None:
    assert parse_device("flexmax@x", broadcast=True).address is None
    for text, why in (
        ("nope", "'nope' is not a line: PROFILE@PORT, as in "),
        ("flexmax:1@x", "a broadcast has no address: PROFILE@PORT"),
    ):
        with pytest.raises(UsageError, match=why):
            parse_device(text, broadcast=True)
