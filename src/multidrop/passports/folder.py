"""A folder of passports: which are there, of which device, which counts, where a new one goes."""

from __future__ import annotations

import contextlib
import os
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote

from multidrop.errors import UsageError
from multidrop.io.connection import Target
from multidrop.passports.backup import load, save
from multidrop.passports.passport import Passport

ENDING = ".passport.toml"

LARGEST = 16_000_000
"""Bytes of a file that is looked into: a passport of all 65,536 indices of a drive has seven million."""


@dataclass(frozen=True, slots=True)
class Kept:
    """A passport and its file."""

    path: Path
    passport: Passport


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
        return max(
            same or alike, key=lambda item: _age(item.passport.time, item.path), default=None
        )


# -- a list that is asked for again and again ---------------------------------------------------


@dataclass(frozen=True, slots=True)
class Listed:
    """What a list shows of a file: of whom the passport is, of when (UTC), and how much is in it.

    `damage` says why it cannot be trusted; where nothing could be read, all else is missing.
    """

    path: Path
    device: str = ""
    profile: str = ""
    address: int | None = None
    time: datetime | None = None
    points: int = 0
    unreadable: int = 0
    damage: str | None = None

    def is_of(self, name: str, target: Target, others: frozenset[str]) -> bool:
        """Whether it is of the device that a plant calls `name`.

        One that was made through another port counts, unless it is one of the
        `others` of the plant. What cannot be read is told by its file's name.
        """
        if not self.device:
            stem = re.escape(_stem(name))
            return bool(
                re.fullmatch(rf"{stem}(-[0-9]{{8}}T[0-9]{{6}}Z(-[0-9]+)?)?", _short(self.path))
            )
        if self.device == str(target.name):
            return True
        alike = (self.profile, self.address) == (target.profile.name, target.name.address)
        return alike and self.device not in others


class Index:
    """The files of a folder in brief; each is read once, and again when it has changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._known: dict[Path, tuple[tuple[int, int], Listed | None]] = {}

    def listed(self) -> list[Listed]:
        """All of them, the newest first. Raises `OSError` where the folder cannot be read."""
        known, self._known = self._known, {}
        for path, stamp in self._files():
            found = known.get(path)
            if found is None or found[0] != stamp:
                found = stamp, _listed(path, stamp[1])
            self._known[path] = found
        listed = [item for _, item in self._known.values() if item is not None]
        never = datetime.min.replace(tzinfo=UTC)
        return sorted(listed, key=lambda item: _age(item.time or never, item.path), reverse=True)

    def _files(self) -> Iterator[tuple[Path, tuple[int, int]]]:
        for path in self.folder.iterdir():
            if path.suffix != ".toml" or path.name.startswith(".") or not _is_text(path.name):
                continue
            with contextlib.suppress(FileNotFoundError):  # it has just gone
                found = path.stat()
                if stat.S_ISREG(found.st_mode):
                    yield path, (found.st_mtime_ns, found.st_size)


def _is_text(name: str) -> bool:
    """Whether nobody will stumble over a file's name: it may be any bytes."""
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return name.isprintable()


def _listed(path: Path, size: int) -> Listed | None:
    """None for what is no passport at all, but something else that ends in .toml."""
    if size > LARGEST:
        return Listed(path, damage=f"{path.name} is larger than {LARGEST} bytes")
    damage = None
    try:
        found = load(path)
    except UsageError as error:
        damage = str(error)
        try:
            found = load(path, damaged=True)  # whose it is, and of when
        except UsageError:
            return Listed(path, damage=damage) if path.name.endswith(ENDING) else None
    return Listed(
        path,
        found.device,
        found.profile,
        found.address,
        found.time,
        len(found.points),
        len(found.unreadable),
        damage,
    )


# -- names of files -----------------------------------------------------------------------------


def _stem(name: str) -> str:
    """A device's name as part of a file's name, that leads into no other folder."""
    return quote(name, safe=" ").replace(".", "%2E")


def _age(time: datetime, path: Path) -> tuple[datetime, int, str]:
    """Sorts passports, the oldest first; of one second the one with the higher number is the later."""
    return time, len(path.name), path.name


def _short(path: Path) -> str:
    return path.name.removesuffix(ENDING)


def save_as_new(passport: Passport, name: str, folder: Path) -> Path:
    """Keep it in a file of its own, named after the device and the time. Raises `UsageError`."""
    stem = f"{_stem(name)}-{passport.time.astimezone(UTC):%Y%m%dT%H%M%S}Z"
    path, number = folder / f"{stem}{ENDING}", 1
    while os.path.lexists(path):
        number += 1
        path = folder / f"{stem}-{number}{ENDING}"
    save(passport, path)
    return path
