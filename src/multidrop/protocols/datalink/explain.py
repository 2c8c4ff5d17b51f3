"""What messages say together: memory as points by the profile's names, a change with its Acknowledge."""

from __future__ import annotations

from collections.abc import Sequence

from multidrop.points import Point, Sample
from multidrop.profile import OfProfile, Profile
from multidrop.protocols.datalink.describe import describe
from multidrop.protocols.datalink.device import memory_map_of
from multidrop.protocols.datalink.frame import Command, Frame
from multidrop.protocols.datalink.layout import Layout, Placed
from multidrop.transaction import Kind, Meaning, shown

_CHANGES = (Command.CHANGE, Command.CHANGE_BITS)

Said = tuple[tuple[tuple[Point, Sample], ...], str]  # values, and the same in words


def continues(frames: Sequence[Frame], frame: Frame) -> bool:
    """Whether it is the Response to the question, or the Acknowledge of the change.

    Of no frames, whether it is a question.
    """
    command = frame.command
    if not frames:
        return command is Command.INTERROGATE or command in _CHANGES
    question = frames[0]
    if command is Command.ACKNOWLEDGE:
        return (
            question.command in _CHANGES
            and frame.address == question.address
            and frames[-1].command is not Command.ACKNOWLEDGE
        )
    return len(frames) == 1 and continues((), question) and frame.answers(question)


def explain(frames: Sequence[Frame], profile: Profile) -> Meaning:
    """What was read, or was to be changed, and what came of it."""
    question = frames[0]
    if question.command is Command.INTERROGATE:
        return _explainer(profile).read(frames)
    if question.command in _CHANGES:
        return _explainer(profile).write(frames)
    return Meaning(Kind.OTHER, describe(question))


class _Explainer:
    """Explains what is said to instruments of one profile; where points lie is found out once."""

    MOST = 4096  # stretches of memory that are remembered

    def __init__(self, profile: Profile) -> None:
        self._layout = Layout(profile, memory_map_of(profile))
        self._known: dict[tuple[int, int], list[Placed]] = {}

    def read(self, frames: Sequence[Frame]) -> Meaning:
        _, _, memory_address, count, _ = frames[0]
        points = self._points(memory_address, count)
        if len(frames) == 1:
            names = ", ".join(placed.shown for placed in points) or f"{memory_address:04X}h/0"
            unread = tuple(placed.point for placed in points)
            return Meaning(Kind.READ, f"read {names}: no answer", complete=False, unread=unread)
        values, text = _values(points, frames[1].data, "=")
        return Meaning(Kind.READ, f"read {text}" if values else describe(frames[1]), values)

    def write(self, frames: Sequence[Frame]) -> Meaning:
        change, last = frames[0], frames[-1]
        bits = change.command is Command.CHANGE_BITS
        values, text = self._bits(change) if bits else self._bytes(change)
        text = f"write {text}" if values else describe(change)
        echo = next((frame for frame in frames if frame.command is Command.RESPONSE), None)
        right = echo is not None and echo.data == change.data
        heard = (
            "" if echo is None or right else f", another echo came: {echo.data.hex(' ').upper()}"
        )
        if last.command is Command.ACKNOWLEDGE:
            heard = heard or ("" if right else ", its echo was not heard")
            return Meaning(Kind.WRITE, f"{text}: acknowledged{heard}", values)
        heard = heard or ("" if right else ", no echo")
        return Meaning(Kind.WRITE, f"{text}: not acknowledged{heard}", values, complete=False)

    # -- memory ----------------------------------------------------------------------------

    def _points(self, memory_address: int, count: int) -> list[Placed]:
        key = memory_address, count
        points = self._known.get(key)
        if points is None:
            points = self._layout.points(memory_address, count)
            if len(self._known) == self.MOST:
                self._known.clear()
            self._known[key] = points
        return points

    def _bytes(self, change: Frame) -> Said:
        return _values(self._points(change.memory_address, change.count), change.data, ":=")

    def _bits(self, change: Frame) -> Said:
        """The bits that both readings of mask and state change; none where a byte is no bits."""
        masks, states = change.data[::2], change.data[1::2]
        found: list[tuple[Point, Sample]] = []
        for at, (mask, state) in enumerate(zip(masks, states, strict=False)):
            points = self._layout.bits(change.memory_address + at, ~mask & 0xFF)
            if points is None or mask & state:
                return (), ""
            found += [(point, point.sample(bytes((state,)))) for point in points]
        return tuple(found), ", ".join(f"{point} := {shown(point, bit)}" for point, bit in found)


_explainer = OfProfile(_Explainer)


def _values(points: Sequence[Placed], memory: bytes, sign: str) -> Said:
    """The samples of those points that these bytes hold, and the same in words."""
    values: list[tuple[Point, Sample]] = []
    texts = []
    for point, start, end, name in points:
        if end <= len(memory):
            sample = point.sample(memory[start:end])
            values.append((point, sample))
            texts.append(f"{name} {sign} {shown(point, sample)}")
    return tuple(values), ", ".join(texts)
