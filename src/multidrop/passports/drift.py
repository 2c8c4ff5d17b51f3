"""Drift: what was changed at the keypads of a plant since its passports were made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from multidrop.errors import Error, UsageError
from multidrop.io.connection import Target, connect
from multidrop.passports.backup import backup
from multidrop.passports.difference import Difference, differences
from multidrop.passports.folder import Kept, Passports, save_as_new
from multidrop.passports.passport import Entry, Passport


@dataclass(frozen=True, slots=True)
class Drift:
    """What became of one device; `error` is why it could not be compared.

    `kept` is the latest passport of it, `now` what it holds.
    """

    name: str
    kept: Kept | None = None
    now: Passport | None = None
    differences: Sequence[Difference] = field(default_factory=tuple)
    error: Error | None = None


def look(name: str, target: Target, passports: Passports) -> Drift:
    """Compare a device with its latest passport. What goes wrong with it is in the result."""
    kept = passports.latest(target)
    try:
        with connect(target) as connection:
            now = backup(connection)
    except Error as error:
        return Drift(name, kept, error=error)
    if kept is None:
        missing = f"{passports.folder} has no passport of it"
        return Drift(name, now=now, error=UsageError(missing))
    changed = [item for item in differences(kept.passport, now) if _both_read(item)]
    return Drift(name, kept, now, changed)


def _both_read(item: Difference) -> bool:
    """A point that the line hid for a moment, or a profile that was changed, is no drift."""
    return isinstance(item.before, Entry) and isinstance(item.after, Entry)


def save_new(drift: Drift, folder: Path) -> Path:
    """Keep what a device holds now as its latest passport. Raises `UsageError`."""
    assert drift.now is not None
    return save_as_new(drift.now, drift.name, folder)
