"""A backup beside polls: each attempt has a turn of its own, in the background; what the line hid is asked for again."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, cast

import pytest

from multidrop.errors import DeviceError, Error, NoReply, PortError
from multidrop.io.connection import Target
from multidrop.io.served import ServedDevice
from multidrop.io.turns import Priority
from multidrop.naming import parse_device
from multidrop.passports.served_backup import ServedBackup
from multidrop.points import Point, Reading

TARGET = Target(parse_device("ax-v:2@/dev/ttyUSB0,attempts=2"))
NAMES = ("ipa_1009", "ipa_1111")


def silence() -> NoReply:
    return NoReply(1)


class Scripted:
    """A device of a line service whose turns go as they are told: an error, or a reading."""

    target = TARGET
    device = TARGET.device()

    def __init__(self, *turns: Error | None) -> None:
        self.turns = list(turns)
        self.asked: list[str | None] = []

    async def poll_group(self, group: Sequence[Point], priority: Priority) -> list[Reading]:
        assert priority is Priority.BACKGROUND
        self.asked += [point.name for point in group]
        error = self.turns.pop(0) if self.turns else None
        if error is not None:
            raise error
        now = datetime.now(UTC)
        return [
            Reading(point.text, point.name, 7, None, "int16", b"\x07\x00", False, now, 1.0, "0700")
            for point in group
        ]


def backed_up(device: Scripted) -> ServedBackup:
    backup = ServedBackup.of(cast("ServedDevice", device))

    async def run() -> list[int]:
        return [done async for done in backup.run()]

    assert asyncio.run(run()) == [1, 2]
    return backup


def test_all_points_in_the_order_of_the_profile() -> None:
    device = Scripted()
    made = backed_up(device).passport()
    assert device.asked == list(NAMES)
    assert [entry.value for entry in made.points.values()] == [7, 7]
    assert made.device == "ax-v:2@/dev/ttyUSB0"


def test_silence_is_asked_again_in_another_turn_and_once_more_at_the_end() -> None:
    device = Scripted(silence(), None, silence(), silence(), None)
    made = backed_up(device).passport()
    first, second = NAMES
    assert device.asked == [first, first, second, second, second]
    assert (len(made.points), made.unreadable) == (2, {})


def test_a_refusal_is_an_answer() -> None:
    device = Scripted(None, DeviceError(3, "not now"))
    (unread,) = backed_up(device).passport().unreadable.values()
    assert (unread.name, "refused" in unread.reason) == ("ipa_1111", True)
    assert device.asked == list(NAMES)


@pytest.mark.parametrize(
    ("turns", "error"),
    [
        ((silence(), silence()), NoReply),  # the very first one
        ((PortError("the port is away"),), PortError),
        ((None, PortError("the port is away")), PortError),
    ],
)
def test_nobody_is_there_any_more(turns: tuple[Any, ...], error: type[Error]) -> None:
    with pytest.raises(error):
        backed_up(Scripted(*turns))
