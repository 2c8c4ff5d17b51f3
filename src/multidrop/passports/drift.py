"""Drift: what was changed at the keypads of a plant since its passports were made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC
from pathlib import Path

from multidrop.errors import Error, UsageError
from multidrop.io.connection import Target, connect
from multidrop.passports.backup import backup, load, save
from multidrop.passports.difference import Difference, differences
from multidrop.passports.passport import Entry, Passport

ENDING = ".passport.toml"


@dataclass(frozen=True, slots=True)
class Kept:
    """A passport and its file."""

    path: Path
    passport: Passport


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


@dataclass(frozen=True, slots=True)
class Passports:
    """The passports of a folder; `unusable` is what looks like one and is not, with the reason."""

    folder: Path
    kept: Sequence[Kept]
    unusable: Mapping[Path, str]

    @classmethod
    def of(cls, folder: Path) -> Passports:
        """Raises `UsageError` where there is no such folder."""
        if not folder.is_dir():
            raise UsageError(f"there is no folder {folder} with passports")
        kept, unusable = [], {}
        for path in sorted(folder.glob("*.toml")):
            try:
                kept.append(Kept(path, load(path)))
            except UsageError as error:
                unusable[path] = str(error)
        return cls(folder, kept, unusable)

    def latest(self, target: Target) -> Kept | None:
        """The newest passport of a device: made under the same name, else of its profile and address."""
        name, address, profile = str(target.name), target.name.address, target.profile.name
        alike = [
            item
            for item in self.kept
            if (item.passport.profile, item.passport.address) == (profile, address)
        ]
        same = [item for item in alike if item.passport.device == name]
        return max(same or alike, key=lambda item: item.passport.time, default=None)


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
    time = drift.now.time.astimezone(UTC)
    path = folder / f"{drift.name}-{time:%Y%m%dT%H%M%S}Z{ENDING}"
    save(drift.now, path)
    return path
