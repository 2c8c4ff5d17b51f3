"""A write to every drive at once. No drive answers it; only the read-back of the point shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from multidrop.broadcasting import Spoken, broadcast, check_role
from multidrop.conversation import Conversation
from multidrop.device import Received
from multidrop.errors import UsageError
from multidrop.points import Point, Sample
from multidrop.profile import Profile
from multidrop.protocols.ultra3000.device import Ultra3000Device, broadcast_of
from multidrop.protocols.ultra3000.frame import Frame
from multidrop.protocols.ultra3000.points import ParameterPoint, View
from multidrop.protocols.ultra3000.values import ACTION, HEX


def prepare_broadcast(
    profile: Profile,
    points: Iterable[tuple[str, str]],
    addresses: Iterable[int],
    options: Mapping[str, str],
    *,
    force: bool = False,
    keep_going: bool = False,
) -> Callable[[], Conversation[Frame, list[Received]]]:
    """Check the whole broadcast; returns the conversation that carries it out."""
    address_of_all = broadcast_of(options)
    drives = [_Drive(Ultra3000Device(address, profile, address_of_all)) for address in addresses]
    speaker = Ultra3000Device(0, profile, address_of_all)
    spoken = [_spoken(speaker, text, value, force) for text, value in points]
    return lambda: broadcast(spoken, drives, keep_going=keep_going)


def _spoken(speaker: Ultra3000Device, text: str, value: str, force: bool) -> Spoken:
    write = speaker.prepare_write(text, value, force=force)
    point = write.point
    assert isinstance(point, ParameterPoint)
    digits = speaker.digits(write, None)
    if point.kind is HEX and not digits:
        raise UsageError(f"{point} needs all its digits to be broadcast, as in 0x0001")
    check_role(point, _Drive.called, force=force)

    def send() -> Conversation[Frame, None]:
        return speaker.master.broadcast_write(
            point.parameter, digits, point.element, non_volatile=point.view is View.NV
        )

    is_action = point.kind is ACTION
    wanted = None if is_action else lambda found: speaker.wanted(write, found)
    return Spoken(point, speaker.asked(write), send, wanted)


class _Drive:
    """A drive that is asked. It cannot say whether it received a broadcast."""

    called = "drive"

    def __init__(self, device: Ultra3000Device) -> None:
        self.address = device.address
        self._device = device

    def prepare(self) -> Conversation[Frame, bool]:
        yield from self._device.master.learn_echo()  # of an action nothing was read
        return True

    def received(self) -> Conversation[Frame, bool | None]:
        return None
        yield  # a conversation without a step

    def read(self, point: Point) -> Conversation[Frame, Sample]:
        assert isinstance(point, ParameterPoint)
        yield from self._device.master.learn_echo()
        return (yield from self._device.sample(point))
