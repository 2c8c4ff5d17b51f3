"""What a question and its answer say: points by the profile's names, values, refusals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from multidrop.errors import ProtocolError
from multidrop.points import Point, Sample
from multidrop.profile import OfProfile, Profile
from multidrop.protocols.slink3.describe import describe
from multidrop.protocols.slink3.device import dialect_of
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.master import (
    NO_REFUSALS,
    MalfunctionCode,
    ParameterValue,
    StatusWord,
)
from multidrop.protocols.slink3.messages import (
    READS,
    WRITES,
    Command,
    Response,
    StandardParameter,
    TypedParameter,
    command_name,
    response_meaning,
)
from multidrop.protocols.slink3.points import ParameterPoint, point_of
from multidrop.protocols.slink3.values import Format
from multidrop.transaction import Kind, Meaning, Refusal, shown

LAST_ADDRESS = 127
"""What is said to a higher address, nobody answers."""

_TYPED = frozenset({Command.READ_TYPED_PARAMETER, Command.WRITE_TYPED_PARAMETER})


def continues(frames: Sequence[Frame], frame: Frame) -> bool:
    """Whether it is the answer to the question; of no frames, whether it is a question."""
    if not frames:
        return not frame.order & 1
    question = frames[0]
    return (
        len(frames) == 1
        and question.address <= LAST_ADDRESS
        and not question.order & 1
        and frame.answers(question)
    )


def explain(frames: Sequence[Frame], profile: Profile) -> Meaning:
    """What a question says, and its answer if there is one."""
    return _explainer(profile).explain(frames)


Values = tuple[tuple[Point, Sample], ...]
Found = tuple[str, Values]  # what follows a question's text, and what was read


@dataclass(frozen=True, slots=True)
class _Asked:
    """A question. `found` reads the data of its OK answer, where that has any."""

    kind: Kind
    text: str
    values: Values = ()
    found: Callable[[bytes, bool | None], Found] | None = None
    expected: int = Response.OK
    unread: tuple[Point, ...] = ()  # what it reads


class _Explainer:
    """Explains what is said to devices of one profile; questions that come again and again, once."""

    MOST = 4096  # questions that are remembered

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._dialect = dialect_of(profile, {})
        self._known: dict[tuple[object, ...], _Asked] = {}

    def explain(self, frames: Sequence[Frame]) -> Meaning:
        question = frames[0]
        if question.is_answer:
            return Meaning(Kind.OTHER, describe(question))
        asked = self._asked(question)
        if len(frames) > 1:
            return self._answered(asked, frames[1])
        if question.address > LAST_ADDRESS:
            return Meaning(asked.kind, f"broadcast {asked.text}", asked.values)
        return Meaning(
            *(asked.kind, f"{asked.text}: no answer", asked.values),
            complete=False,
            unread=asked.unread,
        )

    # -- questions -------------------------------------------------------------------------

    def _asked(self, question: Frame) -> _Asked:
        key = question[2:]  # ORDER, COMMAND and DATA
        asked = self._known.get(key)
        if asked is None:
            asked = self._understood(question)
            if len(self._known) == self.MOST:
                self._known.clear()
            self._known[key] = asked
        return asked

    def _understood(self, question: Frame) -> _Asked:
        code, data = question.code, question.data
        if code in READS or code in WRITES:
            found = (TypedParameter if code in _TYPED else StandardParameter).decode(data)
            if found is not None:
                return self._parameter(question, *found)
        where = f" of destination {question.destination}" if question.destination else ""
        text = f"{command_name(code)}{where}"
        if code in _SERVICES and not data:
            kind, found_by, expected = _SERVICES[code]
            return _Asked(kind, text, (), found_by, expected)
        if data:
            text += f" {data.hex(' ').upper()}"
        kind = Kind.READ if code in READS else Kind.WRITE if code in WRITES else Kind.OTHER
        return _Asked(kind, text, (), _data)

    def _parameter(
        self, question: Frame, parameter: TypedParameter | StandardParameter, value: bytes
    ) -> _Asked:
        point = point_of(parameter, question.destination, self._profile, self._dialect)
        if question.code in READS:
            found = partial(_typed if isinstance(parameter, TypedParameter) else _standard, point)
            return _Asked(Kind.READ, f"read {point}", (), found, unread=(point,))
        if isinstance(parameter, TypedParameter):
            sample = _sample(parameter.type_code, value, None)
        else:
            sample = _sample(point.type_code or Format.OCTET_STRING, value, None)
        return _Asked(Kind.WRITE, f"write {point} := {shown(point, sample)}", ((point, sample),))

    # -- answers ---------------------------------------------------------------------------

    def _answered(self, asked: _Asked, answer: Frame) -> Meaning:
        _, _, order, code, data = answer
        fault = bool(order & 0x10) if self._dialect.fault_bit else None
        said, values, refusal = ": OK", asked.values, None
        if code == asked.expected:
            if asked.found is not None:
                said, found = asked.found(data, fault)
                values = values or found
        elif code in NO_REFUSALS:
            said = f": {response_meaning(code)}"
            if asked.kind is not Kind.WRITE or code != Response.COMMAND_SUBMITTED:
                said += f", {code:04X}h, which is no answer to it"
        elif asked.expected == Response.OK_BROADCAST and code == Response.NOT_OK:
            said = ": no broadcast was received"
        else:
            refusal = Refusal(code, response_meaning(code))
            said = f": refused with {code:04X}h, {refusal.text}"
        if fault:
            said += ", FAULT"
        unread = () if values else asked.unread
        return Meaning(asked.kind, asked.text + said, values, refusal, fault, unread=unread)


_explainer = OfProfile(_Explainer)


# -- what stands in an OK answer ---------------------------------------------------------------


def _sample(type_code: int, raw: bytes, fault: bool | None) -> Sample:
    """The sample of a parameter's bytes; as bytes where they do not fit the type."""
    try:
        return ParameterValue(type_code, raw, bool(fault)).sample(fault)
    except ProtocolError:
        return Sample(raw, Format.OCTET_STRING.type_name, raw, fault)


def _typed(point: ParameterPoint, data: bytes, fault: bool | None) -> Found:
    found = TypedParameter.decode(data)
    if found is None:
        return f": an answer that is too short, {data.hex(' ').upper() or 'empty'}", ()
    sample = _sample(found[0].type_code, found[1], fault)
    return f" = {shown(point, sample)}", ((point, sample),)


def _standard(point: ParameterPoint, data: bytes, fault: bool | None) -> Found:
    sample = _sample(point.type_code or Format.OCTET_STRING, data[3:], fault)
    return f" = {shown(point, sample)}", ((point, sample),)


def _status_word(data: bytes, fault: bool | None) -> Found:
    if len(data) != 2:
        return _data(data, fault)
    found = StatusWord(data[0] | data[1] << 8, bool(fault))
    return f" {found.word:04X}h: {found.state.value} ({', '.join(found.bits) or 'no bit'})", ()


def _malfunction_code(data: bytes, fault: bool | None) -> Found:
    if len(data) != 2:
        return _data(data, fault)
    found = MalfunctionCode(data[0] | data[1] << 8, bool(fault))
    return f" {found.code:04X}h" + (f" ({found.family})" if found.family else ""), ()


def _received(data: bytes, fault: bool | None) -> Found:
    return ": a broadcast was received", ()


def _data(data: bytes, fault: bool | None) -> Found:
    return f": OK {data.hex(' ').upper()}".rstrip(), ()


_SERVICES: dict[int, tuple[Kind, Callable[[bytes, bool | None], Found], int]] = {
    Command.STATUS_WORD: (Kind.STATUS, _status_word, Response.OK),
    Command.MALFUNCTION_CODE: (Kind.STATUS, _malfunction_code, Response.OK),
    Command.BROADCAST_COMMAND_VERIFY: (Kind.OTHER, _received, Response.OK_BROADCAST),
}
