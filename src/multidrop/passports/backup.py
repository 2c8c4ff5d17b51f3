"""Backup: every readable point of a device into a passport, and passports as files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from multidrop.errors import Error, NoReply, PortError, ProtocolError, UsageError
from multidrop.io.connection import BaseConnection, Connection, Target
from multidrop.io.readings import in_a_row, readable
from multidrop.io.text_file import write_whole
from multidrop.passports.passport import Entry, Passport, Unread
from multidrop.points import Point, Reading

GONE = 3
"""So many reads in a row without a reply, or the very first one, and the device counts as gone."""


@dataclass(slots=True)
class Known:
    """What is known so far of a backup: `points` are what will be read."""

    connection: BaseConnection
    points: Sequence[Point]
    found: dict[str, Entry] = field(default_factory=dict)
    failed: dict[str, Error] = field(default_factory=dict)
    _silent: list[NoReply] = field(default_factory=list)  # in a row

    def note(self, point: Point, found: Reading | Error) -> None:
        """A point was read, or not. Raises `PortError` when the port is lost, `NoReply` when the device has gone."""
        if isinstance(found, PortError):
            raise found
        if isinstance(found, Error):
            self._note_silence(found)
            self.failed[point.text] = found
        else:
            self._silent.clear()
            self.failed.pop(point.text, None)
            self.found[point.text] = entry(point, found)

    def _note_silence(self, error: Error) -> None:
        """Points that were asked together share one error, and count once."""
        if isinstance(error, NoReply) and error not in self._silent:
            self._silent.append(error)
            if not self.found or len(self._silent) == GONE:
                raise error

    def hidden(self) -> list[Point]:
        """What a bad moment of the line hid, which is worth another try."""
        return [
            point
            for point in self.points
            if isinstance(self.failed.get(point.text), NoReply | ProtocolError)
        ]

    def passport(self) -> Passport:
        """The passport, its points in the order of the profile."""
        unreadable = {
            point.text: Unread(point.text, point.name, point.role, str(self.failed[point.text]))
            for point in self.points
            if point.text in self.failed and point.text not in self.found
        }
        in_profile_order = {
            point.text: self.found[point.text] for point in self.points if point.text in self.found
        }
        return passport(self.connection.target, in_profile_order, unreadable)


@dataclass(slots=True)
class Backup(Known):
    """A backup on its way, through a connection that does nothing else."""

    connection: Connection

    @classmethod
    def of(cls, connection: Connection) -> Backup:
        """Of every readable point of the device's profile. Raises `UsageError` where it has none."""
        return cls(connection, readable(connection.device))

    def run(self) -> Iterator[Point]:
        """Read them all; gives each point when it is known.

        What a bad moment of the line hid is tried once more at the end. Raises
        `PortError` when the port is lost, `NoReply` when the device has gone.
        """
        for point, found in in_a_row(self.connection, self.points):
            self.note(point, found)
            yield point
        for point, found in in_a_row(self.connection, self.hidden()):
            self.note(point, found)


def backup(connection: Connection) -> Passport:
    """The passport of a device, read at once."""
    run = Backup.of(connection)
    for _ in run.run():
        pass
    return run.passport()


def passport(
    target: Target, points: dict[str, Entry], unreadable: dict[str, Unread] | None = None
) -> Passport:
    """A passport of a device as it is named and set."""
    assert target.name.address is not None
    return Passport(
        device=str(target.name),
        profile=target.profile.name,
        profile_version=target.profile.version,
        address=target.name.address,
        baud=target.settings.baud,
        format=str(target.settings.format),
        time=datetime.now(UTC),
        multidrop=version("multidrop"),
        points=points,
        unreadable=unreadable or {},
    )


def entry(point: Point, reading: Reading) -> Entry:
    """A reading as a passport keeps it."""
    return Entry(
        point=point.text,
        name=point.name,
        role=point.role,
        value=reading.value,
        unit=reading.unit,
        type=reading.type,
        raw=reading.raw_text,
    )


# -- files ------------------------------------------------------------------------------------


def save(passport: Passport, path: Path) -> None:
    """Write it whole or not at all: under another name first. Raises `UsageError`."""
    write_whole(passport.to_text(), path)


def load(path: Path, *, damaged: bool = False) -> Passport:
    """Read a passport's file. Raises `UsageError` that names file, key and reason."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: no passport: not UTF-8 text") from None
    return Passport.from_text(text, str(path), damaged=damaged)
