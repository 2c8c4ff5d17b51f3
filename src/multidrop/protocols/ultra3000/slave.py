"""The drive's side: bytes in, requests out; replies in, bytes out. It calls no device.

::

    for request in slave.receive_data(data):
        reply = request.settled or ...   # what the drive says
        to_send = slave.answer(request, reply)

What follows from the profile alone (a function that the parameter does not
have, an index or a value out of range) arrives with `settled` filled in; damage
and frames for others get silence and do not arrive at all. What depends on the
drive's state (refusals 02, 03 and 06) is for the caller.
"""

from __future__ import annotations

from dataclasses import dataclass

from multidrop.errors import UsageError
from multidrop.profile import Profile
from multidrop.protocols.ultra3000.frame import READS, REFUSED, Frame, decoder
from multidrop.protocols.ultra3000.messages import (
    BROADCAST,
    INDEXED,
    LAST_ADDRESS,
    WRITES,
    Function,
    Refusal,
)
from multidrop.protocols.ultra3000.points import ParameterPoint, parse_point
from multidrop.protocols.ultra3000.values import ACTION, INTEGERS, decode_value
from multidrop.serving import BaseSlave


@dataclass(frozen=True, slots=True)
class Reply:
    """What a drive says: a refusal (0 for none), or the digits of a value."""

    refusal: int = 0
    data: str = ""


@dataclass(frozen=True, slots=True)
class Request:
    """One request to this drive.

    `element` is an array's index, `value` the digits behind it; without a
    profile nobody knows arrays, and all of the data is `value`. A `broadcast` is
    carried out and not answered.
    """

    frame: Frame
    element: int | None = None
    value: str = ""
    broadcast: bool = False
    settled: Reply | None = None

    @property
    def parameter(self) -> int:
        return self.frame.parameter

    @property
    def function(self) -> int:
        return self.frame.function


class Slave(BaseSlave[Frame, Request]):
    """The drive at `address`, 0..253, that also hears `broadcast`, with the parameters of `profile`."""

    def __init__(
        self, address: int, *, broadcast: int = BROADCAST, profile: Profile | None = None
    ) -> None:
        if not 0 <= address <= LAST_ADDRESS:
            raise UsageError(f"address {address} is out of range: a drive has 0..{LAST_ADDRESS}")
        super().__init__(address, decoder())
        self.broadcast = broadcast
        self._parameters = _parameters(profile) if profile is not None else None

    def answer(self, request: Request, reply: Reply) -> bytes:
        """The bytes to send for a request: none for a broadcast."""
        if request.broadcast:
            return b""
        frame = request.frame
        if reply.refusal:
            refused = frame.parameter + REFUSED
            return Frame(frame.address, refused, frame.function, f"{reply.refusal:02X}").encode()
        data = reply.data if frame.function in READS else ""
        return Frame(frame.address, frame.parameter, frame.function, data).encode()

    # -- what the protocol and the profile decide --------------------------------------------

    def _receive(self, frame: Frame) -> Request | None:
        if frame.is_refusal:
            return None
        if frame.address == self.address:
            return self._understood(frame)
        if frame.address != self.broadcast or frame.function in READS:
            return None
        request = self._understood(frame, broadcast=True)
        return None if request.settled is not None else request

    def _understood(self, frame: Frame, *, broadcast: bool = False) -> Request:
        if self._parameters is None:
            known = frame.function in Function._value2member_map_
            settled = None if known else Reply(Refusal.INVALID_FUNCTION)
            return Request(frame, None, frame.data, broadcast, settled)
        point = self._parameters.get(frame.parameter)
        if point is None or not _offers(point, frame.function):
            return Request(frame, broadcast=broadcast, settled=Reply(Refusal.INVALID_FUNCTION))
        element, value = None, frame.data
        if point.elements is not None and frame.function in INDEXED:
            element = int(value[:2], 16) if len(value) >= 2 else None
            value = value[2:]
            if element is None or element >= point.elements:
                settled = Reply(Refusal.INVALID_INDEX)
                return Request(frame, element, value, broadcast, settled)
        refusal = _refused(point, frame.function, value)
        return Request(frame, element, value, broadcast, Reply(refusal) if refusal else None)


def _offers(point: ParameterPoint, function: int) -> bool:
    return function in Function._value2member_map_ and point.offers(Function(function))


def _parameters(profile: Profile) -> dict[int, ParameterPoint]:
    points = (parse_point(name, profile, whole=True) for name in profile.points)
    return {point.parameter: point for point in points}


def _refused(point: ParameterPoint, function: int, value: str) -> Refusal | None:
    """Why the value of a write cannot be taken, by what the profile says of it."""
    if function not in WRITES or point.kind is ACTION:
        return Refusal.INVALID_DATA if value else None
    if len(value) not in (kind.digits for kind in point.kinds):
        return Refusal.INVALID_DATA
    if point.kind.name not in INTEGERS:
        return None
    kind = next(kind for kind in point.kinds if kind.digits == len(value))
    description = point.description
    assert description is not None, "only a profile gives a type"
    raw = decode_value(kind, value)
    assert isinstance(raw, int)
    physical = description.physical(raw)
    assert isinstance(physical, int | float)
    if description.minimum is not None and physical < description.minimum:
        return Refusal.BELOW_MINIMUM
    if description.maximum is not None and physical > description.maximum:
        return Refusal.ABOVE_MAXIMUM
    try:
        description.check_limits(physical)
    except UsageError:
        return Refusal.INVALID_DATA
    return None
