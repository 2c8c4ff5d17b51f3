"""A backup of a device that a line service polls meanwhile."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass

from multidrop.errors import Error, NoReply
from multidrop.io.readings import readable
from multidrop.io.served import ServedDevice
from multidrop.io.turns import Priority
from multidrop.passports.backup import Known
from multidrop.points import Point, Reading


@dataclass(slots=True)
class ServedBackup(Known):
    """It takes the turns that are left over, and holds the line for one question at a time."""

    connection: ServedDevice

    @classmethod
    def of(cls, device: ServedDevice) -> ServedBackup:
        """Of every readable point of the device's profile. Raises `UsageError` where it has none."""
        return cls(device, readable(device.device))

    async def run(self) -> AsyncIterator[int]:
        """As `Backup.run`; gives how many points were asked for so far."""
        done = 0
        for group in self.connection.device.plan(self.points):
            await self._read(group)
            done += len(group)
            yield done
        for group in self.connection.device.plan(self.hidden()):
            await self._read(group)

    async def _read(self, group: Sequence[Point]) -> None:
        """Each attempt in a turn of its own, so that silence costs the others one time-out at a time."""
        found: Sequence[Reading | Error] = ()
        for _ in range(self.connection.target.settings.attempts):
            try:
                found = await self.connection.poll_group(group, Priority.BACKGROUND)
                break
            except Error as error:
                found = [error] * len(group)
                if not isinstance(error, NoReply):
                    break
        for point, one in zip(group, found, strict=True):
            self.note(point, one)
