"""A write to every slave at once, and the proof of it: A chapter 9.

0081 to broadcast command verify means that a broadcast was received, not that
its value was taken; only the read-back of the point shows that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from multidrop.broadcasting import Spoken, broadcast, check_role
from multidrop.conversation import Conversation
from multidrop.device import Received
from multidrop.errors import UsageError
from multidrop.points import Point, Sample
from multidrop.profile import Profile
from multidrop.protocols.slink3.device import Slink3Device, dialect_of
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.messages import Command
from multidrop.protocols.slink3.points import ParameterPoint
from multidrop.protocols.slink3.values import Format


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
    dialect = dialect_of(profile, options)
    slaves = [_Slave(Slink3Device(address, profile, dialect)) for address in addresses]
    speaker = Slink3Device(0, profile, dialect)
    spoken = [_spoken(speaker, text, value, force) for text, value in points]
    return lambda: broadcast(spoken, slaves, keep_going=keep_going)


def _spoken(speaker: Slink3Device, text: str, value: str, force: bool) -> Spoken:
    write = speaker.prepare_write(text, value, force=force)
    point = write.point
    assert isinstance(point, ParameterPoint)
    if point.destination:
        raise UsageError(
            f"{point} is behind destination {point.destination}, which hears no broadcast"
        )
    type_code = point.type_code
    if type_code is None or type_code is Format.VOID:
        raise UsageError(f"{point} needs a type to be broadcast, such as {point.text}:int16")
    check_role(point, _Slave.called, force=force)
    raw_value, raw = speaker.encoded(write)

    def send() -> Conversation[Frame, None]:
        if point.standard:
            return speaker.master.broadcast_standard(
                point.index, point.subindex or 0, type_code, raw_value
            )
        return speaker.master.broadcast_typed(point.index, type_code, raw_value, point.subindex)

    return Spoken(point, speaker.asked(write), send, lambda _: raw)


class _Slave:
    """A slave that is asked: where its dialect has it, whether it received the broadcast."""

    called = "slave"

    def __init__(self, device: Slink3Device) -> None:
        self.address = device.address
        self._device = device

    def prepare(self) -> Conversation[Frame, bool]:
        if not self._verifies:
            return True
        yield from self._device.master.status_word()  # any other command clears the flag
        return not (yield from self._device.master.broadcast_verify())

    def received(self) -> Conversation[Frame, bool | None]:
        return (yield from self._device.master.broadcast_verify()) if self._verifies else None

    def read(self, point: Point) -> Conversation[Frame, Sample]:
        return self._device.read(point)

    @property
    def _verifies(self) -> bool:
        return Command.BROADCAST_COMMAND_VERIFY in self._device.dialect.commands
