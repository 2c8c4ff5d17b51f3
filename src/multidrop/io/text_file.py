"""Text files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from multidrop.errors import UsageError


def write_whole(text: str, path: Path, encoding: str = "utf-8") -> None:
    """Write a file under another name first. Raises `UsageError`."""
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.unfinished")
    try:
        with unfinished.open("w", encoding=encoding, newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink()


def check_place(path: Path, *, force: bool = False) -> None:
    """Before any work: is there a folder that takes it, and nothing there yet? Raises `UsageError`."""
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}")
    if not os.access(path.parent, os.W_OK):
        raise UsageError(f"{path}: nothing may be written into {path.parent}")
    if path.is_dir():
        raise UsageError(f"{path} is a folder")
    if path.exists() and not force:
        raise UsageError(f"{path} is there already; --force replaces it")
