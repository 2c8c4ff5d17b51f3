"""The log of every write: JSON Lines, append only, in the user's state folder."""

from __future__ import annotations

import errno
import json
import os
import socket
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from multidrop.errors import UsageError
from multidrop.points import Sample, Value
from multidrop.profile import PointDescription
from multidrop.writing import Written

ROOM = 4096
"""Bytes that must be free on the disk before a write; no line is longer."""

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}

ENVIRONMENT = "MULTIDROP_AUDIT"
"""Names another file for the log."""


def default_path() -> Path:
    """`audit.jsonl` in the user's state folder, or what the environment variable names."""
    chosen = os.environ.get(ENVIRONMENT)
    if chosen:
        return Path(chosen)
    from platformdirs import user_state_path

    return user_state_path("multidrop", appauthor=False) / "audit.jsonl"


class AuditLog:
    """Who wrote what, from where, and what came of it. One line a write."""

    def __init__(
        self,
        path: Path | None = None,
        *,
        origin: str,
        force: bool = False,
        who: str | None = None,
    ) -> None:
        self._path = path
        self._origin = origin
        self._who = who
        self.lines = 0  # appended by this one
        self._force = force

    @property
    def path(self) -> Path:
        """Found out when it is first needed: a command that only reads must start fast."""
        if self._path is None:
            self._path = default_path()
        return self._path

    def of(self, who: str, origin: str) -> AuditLog:
        """The same log for what somebody else asks for, and from where."""
        return AuditLog(self._path, origin=origin, force=self._force, who=who)

    def check(self) -> None:
        """Before a write: raises `UsageError` if the log cannot be written, unless forced."""
        try:
            self._append("")
            self._demand_room()
        except OSError as error:
            if not self._force:
                raise UsageError(
                    f"the audit log {self.path} cannot be written ({error.strerror}), so nothing is "
                    f"written to the device; set {ENVIRONMENT} to another file, or use --force"
                ) from None

    def written(self, device: str, record: Written) -> None:
        """Append what is known of one write."""
        description = record.point.description
        self.append(
            device,
            str(record.point.text),
            name=record.point.name,
            old=shown(record.old, description),
            asked=jsonable(record.asked),
            found=shown(record.found, description),
            outcome=record.outcome.value,
        )

    def append(self, device: str, point: str, **facts: Any) -> None:
        """Append one line; facts are those of `written`, null where they are not given, and others."""
        line = {
            "time": datetime.now(UTC).isoformat(timespec="microseconds"),
            "who": self._who or f"{_user()}@{socket.gethostname()}",
            "from": self._origin,
            "device": device,
            "point": point,
            **dict.fromkeys(("name", "old", "asked", "found", "outcome")),
            **facts,
        }
        try:
            self._append(json.dumps(line, ensure_ascii=False) + "\n")
            self.lines += 1
        except OSError:
            if not self._force:
                raise

    def _demand_room(self) -> None:
        """A full disk takes nothing but an empty line. Raises `OSError`."""
        import tempfile

        try:
            with tempfile.TemporaryFile(dir=self.path.parent) as room:
                room.write(bytes(ROOM))
                room.flush()
        except OSError as error:
            if error.errno in FULL:  # nobody may make files here, say: then the log tells
                raise

    def _append(self, text: str) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as log:
            log.write(text)


def jsonable(value: Value | None) -> Any:
    """A value as JSON has it: bytes in hex; NaN and infinities, which JSON has not, as null."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    return value


def shown(sample: Sample | None, description: PointDescription | None) -> Any:
    """The physical value of a sample, for JSON."""
    if sample is None:
        return None
    return jsonable(description.physical(sample.value) if description else sample.value)


def _user() -> str:
    import getpass

    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "unknown"
