"""What a question and its answer say: parameters by the profile's names, values, refusals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from multidrop.errors import ProtocolError
from multidrop.points import Point, Sample
from multidrop.profile import OfProfile, Profile
from multidrop.protocols.ultra3000.describe import describe, from_master
from multidrop.protocols.ultra3000.frame import READS, REFUSED, Frame
from multidrop.protocols.ultra3000.messages import (
    INDEXED,
    LAST_ADDRESS,
    WRITES,
    Function,
    function_name,
    refusal_meaning,
)
from multidrop.protocols.ultra3000.points import ParameterPoint, View, point_of
from multidrop.protocols.ultra3000.values import ACTION, HEX, decode_value
from multidrop.transaction import Kind, Meaning, Refusal, shown

_VIEWS: dict[int, View] = {
    function: view for view in View for function in (view.read, view.write) if function is not None
}
_COPIES = {
    Function.COPY_NON_VOLATILE_TO_WORKING: "load",
    Function.COPY_WORKING_TO_NON_VOLATILE: "save",
    Function.COPY_DEFAULT: "restore the default of",
}
_INDEX_LIMITS = {
    Function.READ_INDEX_MINIMUM: "read the least index of",
    Function.READ_INDEX_MAXIMUM: "read the greatest index of",
}


def continues(frames: Sequence[Frame], frame: Frame) -> bool:
    """Whether it is the answer to the question; of no frames, whether it may be a question.

    Not every frame shows who sent it. A write with other data than the one
    before is no answer to that, but the next question.
    """
    if not frames:
        return _may_ask(frame)
    question = frames[0]
    return (
        len(frames) == 1
        and question.address <= LAST_ADDRESS
        and frame.answers(question)
        and _may_ask(question)
        and (
            frame.function in READS
            or frame.is_refusal
            or not frame.data
            or frame.data == question.data
        )
    )


def _may_ask(frame: Frame) -> bool:
    """From a master for certain; or an action, or the read of an element."""
    if from_master(frame):
        return True
    if frame.is_refusal:
        return False
    if frame.function in WRITES:
        return True
    return len(frame.data) == 2 and frame.function in INDEXED


def explain(frames: Sequence[Frame], profile: Profile) -> Meaning:
    """What a question says, and its answer if there is one."""
    return _explainer(profile).explain(frames)


class _Asked(NamedTuple):
    """A question; `point` where its answer has the value of one."""

    kind: Kind
    text: str
    values: tuple[tuple[Point, Sample], ...] = ()
    point: ParameterPoint | None = None


class _Explainer:
    """Explains what is said to drives of one profile; questions that come again and again, once."""

    MOST = 4096  # questions that are remembered

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._known: dict[tuple[object, ...], _Asked] = {}

    def explain(self, frames: Sequence[Frame]) -> Meaning:
        question = frames[0]
        if question.is_refusal:
            return Meaning(Kind.OTHER, describe(question))
        key = question[1:]  # parameter, function and data
        asked = self._known.get(key)
        if asked is None:
            asked = _understood(question, self._profile)
            if len(self._known) == self.MOST:
                self._known.clear()
            self._known[key] = asked
        if len(frames) > 1:
            return _answered(asked, frames[1])
        if question.address > LAST_ADDRESS:
            return Meaning(asked.kind, f"broadcast {asked.text}", asked.values)
        return Meaning(
            *(asked.kind, f"{asked.text}: no answer", asked.values),
            complete=False,
            unread=() if asked.point is None else (asked.point,),
        )


_explainer = OfProfile(_Explainer)


def _understood(question: Frame, profile: Profile) -> _Asked:
    _, parameter, function, data = question
    reads = function in READS
    view = _VIEWS.get(function, View.WORKING)
    indexed = data if function in INDEXED else ""
    point, value = point_of(parameter, indexed, view, profile, reads=reads)
    if function in _INDEX_LIMITS:
        return _Asked(Kind.READ, f"{_INDEX_LIMITS[Function(function)]} {point}")
    if reads:
        return _Asked(Kind.READ, f"read {point}", (), point)
    if function in _COPIES:
        return _Asked(Kind.WRITE, f"{_COPIES[Function(function)]} {point}")
    if function not in WRITES:
        return _Asked(Kind.OTHER, f"{function_name(function)} {point} {data}".rstrip())
    sample = _sample(point, value)
    if value:
        return _Asked(Kind.WRITE, f"write {point} := {shown(point, sample)}", ((point, sample),))
    return _Asked(Kind.WRITE, f"do {point}", ((point, sample),))


def _answered(asked: _Asked, answer: Frame) -> Meaning:
    kind, text, values, point = asked
    data = answer.data
    if answer.parameter >= REFUSED:
        code = int(data, 16) if data else None
        meaning = refusal_meaning(code) if code is not None else "no code"
        said = f"{text}: refused with {data or 'nothing'}, {meaning}"
        unread = () if point is None else (point,)
        return Meaning(kind, said, values, Refusal(code, meaning), unread=unread)
    if point is not None:
        sample = _sample(point, data)
        return Meaning(kind, f"{text} = {shown(point, sample)}", ((point, sample),))
    if kind is Kind.READ:
        return Meaning(kind, f"{text} = {int(data or '0', 16)}")
    return Meaning(kind, f"{text}: OK", values)


def _sample(point: ParameterPoint, data: str) -> Sample:
    """The sample of these digits; as digits where they do not fit the type, none of an action."""
    if not data:
        return Sample("", ACTION.name, b"")
    if point.kind is not ACTION:
        try:
            return point.sample(data)
        except (ProtocolError, ValueError):  # a profile may call half of a type an action
            pass
    return Sample(decode_value(HEX, data), HEX.name, data.encode())
