"""What a discovery has found so far, as a file: whoever was interrupted goes on from there.

JSON Lines: the head says what is being discovered, each further line is one
place. A line that was cut short by the end of its program is looked at again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from multidrop.errors import UsageError
from multidrop.points import PointDescription
from multidrop.profile import described_point
from multidrop.tools.profiles.text import said_of_point

VERSION = 1


class State:
    """Places that were looked at, each with the points that are there. Use it in a `with`."""

    def __init__(self, path: Path, head: Mapping[str, Any], *, resume: bool = False) -> None:
        """Begin, or go on with `resume`. Raises `UsageError`."""
        self.path = path
        self.found: dict[int, list[PointDescription]] = {}
        wanted = {"v": VERSION, **head}
        whole = self._read(wanted) if resume else b""
        try:
            self._file = path.open("r+b" if resume else "xb", buffering=0)
        except FileExistsError:
            raise UsageError(
                f"{path} is there: a discovery that was not finished; --resume goes on with it,"
                " --force begins anew"
            ) from None
        except OSError as error:
            raise UsageError(f"{path} cannot be written: {error.strerror}") from None
        self._file.truncate(len(whole))
        self._file.seek(len(whole))
        if not whole:
            self._write(wanted)

    def _read(self, wanted: Mapping[str, Any]) -> bytes:
        """What is whole of the file."""
        try:
            data = self.path.read_bytes()
        except FileNotFoundError:
            raise UsageError(f"there is nothing to go on with: {self.path} is not there") from None
        except OSError as error:
            raise UsageError(f"{self.path}: {error.strerror}") from None
        whole = data[: data.rfind(b"\n") + 1]
        lines = whole.splitlines()
        if not lines:
            return b""
        try:
            head = json.loads(lines[0])
            if head != wanted:
                raise UsageError(f"{self.path} is of another discovery: {_differs(head, wanted)}")
            for line in lines[1:]:
                entry = json.loads(line)
                self.found[int(entry["place"])] = [
                    described_point(item.pop("name"), item, str(self.path))
                    for item in entry.get("points", ())
                ]
        except (ValueError, KeyError, TypeError, AttributeError):
            raise UsageError(f"{self.path}: no state of a discovery; --force begins anew") from None
        return whole

    def add(self, place: int, points: list[PointDescription]) -> None:
        self.found[place] = points
        entry: dict[str, Any] = {"place": place}
        if points:
            entry["points"] = [{"name": item.name, **said_of_point(item)} for item in points]
        self._write(entry)

    def _write(self, entry: Mapping[str, Any]) -> None:
        try:
            self._file.write(json.dumps(entry, ensure_ascii=False).encode() + b"\n")
        except OSError as error:
            raise UsageError(f"{self.path} cannot be written: {error.strerror}") from None

    def remove(self) -> None:
        """The discovery is over."""
        self._file.close()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> State:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _differs(found: Any, wanted: Mapping[str, Any]) -> str:
    if not isinstance(found, dict):
        return "it has no head"
    for key, value in wanted.items():
        if found.get(key) != value:
            return f"{key} {found.get(key)!r}, not {value!r}"
    return "it says more"
