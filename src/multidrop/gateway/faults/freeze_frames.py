"""Freeze-frames on disk: one JSON file for each trip, in a folder for each device."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

from multidrop.errors import UsageError

SUFFIX = ".json"

FreezeFrame = dict[str, Any]
"""As the file has it: docs/reference/freeze-frame.md."""


class FreezeFrames:
    """The freeze-frames of a plant. Each has a name that says when it was; they sort by it."""

    def __init__(self, folder: Path, keep: int = 100) -> None:
        self._folder = folder
        self._keep = keep

    def check(self) -> None:
        """Raises `UsageError` where nothing could be kept."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(
                f"freeze-frames cannot be kept in {self._folder}: {error.strerror}"
            ) from None
        if not os.access(self._folder, os.W_OK):
            raise UsageError(f"freeze-frames cannot be kept in {self._folder}: not writable")

    def names(self, device: str) -> list[str]:
        """Of those of a device, newest first."""
        folder = self._of(device)
        if not folder.is_dir():
            return []
        return sorted((path.stem for path in folder.glob(f"*{SUFFIX}")), reverse=True)

    def load(self, device: str, name: str) -> FreezeFrame:
        """Raises `UsageError` where there is none of this name, or the file is damaged."""
        if name not in self.names(device):
            raise UsageError(f"{device} has no freeze-frame {name!r}")
        path = self._of(device) / f"{name}{SUFFIX}"
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise UsageError(f"{path} is no freeze-frame: {error}") from None
        if not isinstance(found, dict) or found.get("v") != 1:
            raise UsageError(f"{path} is no freeze-frame that this version knows")
        return found

    def save(self, frame: FreezeFrame) -> None:
        """Write one, whole or not at all, and forget the oldest of its device. Raises `OSError`."""
        device, name = frame["device"], name_of(frame)
        folder = self._of(device)
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{name}{SUFFIX}"
        unfinished = path.with_suffix(".new")
        with unfinished.open("w", encoding="utf-8") as file:
            json.dump(frame, file, ensure_ascii=False, indent=1)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
        for old in self.names(device)[self._keep :]:
            (folder / f"{old}{SUFFIX}").unlink(missing_ok=True)

    def newest(self, device: str) -> FreezeFrame | None:
        """None where there is none, or it is damaged."""
        for name in self.names(device)[:1]:
            try:
                return self.load(device, name)
            except UsageError:
                return None
        return None

    def _of(self, device: str) -> Path:
        """A folder name that no device's name can lead out of."""
        return self._folder / quote(device, safe=" ").replace(".", "%2E")


def name_of(frame: FreezeFrame) -> str:
    """`2026-11-22T02-31-07.123456Z`: file systems that know no colons can hold it."""
    return str(frame["time"]).replace(":", "-")
