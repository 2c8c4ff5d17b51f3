"""What holds for SLINK3: values, points, and the truth of what a master reports on a bad line."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any

from choices import Choices, tried_with
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.strategies import DataObject
from strategies import profile_of

from multidrop import errors
from multidrop.conversation import Ask
from multidrop.exchange import Exchange
from multidrop.points import Role
from multidrop.profile import PointDescription
from multidrop.protocols import PROTOCOLS, slink3
from multidrop.protocols.slink3 import Format, Slave
from multidrop.protocols.slink3.describe import describe
from multidrop.protocols.slink3.device import Slink3Device
from multidrop.protocols.slink3.points import ParameterPoint, parse_point
from multidrop.protocols.slink3.slave import Reply
from multidrop.protocols.slink3.values import decode_value, encode_value, parse_value
from multidrop.session import Session
from multidrop.writing import Outcome

INTEGERS = {
    Format.CHAR: (8, True),
    Format.SHORT_INT: (16, True),
    Format.LONG_INT: (32, True),
    Format.UNSIGNED_CHAR: (8, False),
    Format.UNSIGNED_SHORT_INT: (16, False),
    Format.UNSIGNED_LONG_INT: (32, False),
}


@cache
def values_of(type_code: Format) -> st.SearchStrategy[Any]:
    if type_code in INTEGERS:
        bits, signed = INTEGERS[type_code]
        least = -(1 << bits - 1) if signed else 0
        return st.integers(least, least + (1 << bits) - 1)
    known: dict[Format, st.SearchStrategy[Any]] = {
        Format.BOOLEAN: st.booleans(),
        Format.FLOAT: st.floats(width=32, allow_nan=False),
        Format.STRING: st.text(st.characters(max_codepoint=0xFF), max_size=244).map(
            lambda text: text.rstrip("\0")
        ),
        Format.OCTET_STRING: st.binary(max_size=244),
    }
    return known[type_code]


TYPES = st.sampled_from(
    [*INTEGERS, Format.BOOLEAN, Format.FLOAT, Format.STRING, Format.OCTET_STRING]
)


@given(st.data(), TYPES)
def test_a_value_comes_back_from_its_bytes(data: DataObject, type_code: Format) -> None:
    value = data.draw(values_of(type_code))
    assert decode_value(type_code, encode_value(type_code, value)) == value


@given(st.data(), TYPES)
def test_a_value_comes_back_from_its_text(data: DataObject, type_code: Format) -> None:
    value = data.draw(values_of(type_code))
    text = value.hex() if isinstance(value, bytes) else str(value)
    assert parse_value(type_code, text) == value


@given(TYPES, st.integers() | st.floats() | st.text(max_size=5) | st.binary(max_size=5))
def test_a_value_fits_its_type_or_is_refused(type_code: Format, value: Any) -> None:
    try:
        raw = encode_value(type_code, value)
    except errors.UsageError:
        return
    again = decode_value(type_code, raw)
    if isinstance(value, float) and type_code is Format.FLOAT:
        assert isinstance(again, float)
        assert (
            math.isnan(again)
            if math.isnan(value)
            else math.isclose(again, value, rel_tol=1e-6, abs_tol=1e-44)
        )
    elif isinstance(value, str):
        assert again == value.rstrip("\0")
    elif type_code is not Format.FLOAT:
        assert again == (
            value.decode("latin-1").rstrip("\0") if type_code is Format.STRING else value
        )


PROFILES = st.sampled_from(["slink3", "flexmax", "ax-v", "dgfc386"])
PIECES = ["std", "dgfc", "drive", "dest2", "dest9", "/", ".", ":", "8236", "0x6041", "-1", "70000", "255",
          "256", "int16", "auto", "bytes", "p44", "control_word", "address", " ", "="]  # fmt: skip
TEXTS = st.lists(st.sampled_from(PIECES), max_size=8).map("".join) | st.text(max_size=12)


@example("dgfc386", "drive/255")
@given(PROFILES, TEXTS)
def test_any_text_is_a_point_or_is_refused(name: str, text: str) -> None:
    device = PROTOCOLS["slink3"].device(1, profile_of(name), {})
    assert isinstance(device, Slink3Device)
    try:
        point = device.point(text)
    except errors.UsageError:
        return
    assert isinstance(point, ParameterPoint)
    again = parse_point(
        f"{point.text}:{point.type}" if point.type else point.text,
        device.profile,
        device.master.dialect,
    )
    assert (again.index, again.subindex, again.standard) == (
        point.index,
        point.subindex,
        point.standard,
    )


@given(PROFILES, TEXTS, st.text(max_size=8) | st.integers() | st.floats(), st.booleans())
def test_any_write_is_prepared_or_refused(name: str, text: str, value: Any, force: bool) -> None:
    device = PROTOCOLS["slink3"].device(1, profile_of(name), {})
    with suppress(errors.UsageError):
        write = device.prepare_write(text, value, force=force)
        assert write.value is value or isinstance(value, str)


@given(PROFILES, TEXTS | st.binary(max_size=260).map(bytes.hex))
def test_any_raw_command_is_prepared_or_refused(name: str, text: str) -> None:
    device = PROTOCOLS["slink3"].device(1, profile_of(name), {})
    with suppress(errors.UsageError):
        step = next(device.prepare_raw(text)())
        assert isinstance(step, Ask)
        assert step.frame.address == 1


@given(st.binary(min_size=5, max_size=252))
def test_any_frame_is_described_in_one_line(fields: bytes) -> None:
    address, control, order, low, high = fields[:5]
    frame = slink3.Frame(address, control, order, low | high << 8, fields[5:])
    assert "\n" not in describe(frame)


class BadLine:
    """A slave with one parameter behind a line that loses, delays, doubles and cuts what it carries.

    Nothing that it does deceives an 8-bit checksum: that is another property, which no code has.
    """

    def __init__(self, value: int, choices: Choices) -> None:
        self.slave = Slave(1, slink3.FLEXMAX)
        self.value = value.to_bytes(2, "little", signed=True)
        self.written = 0
        self._choices = choices
        self._coming: list[tuple[float, bytes]] = []

    def receive(self, sent: bytes, now: float) -> None:
        fate = self._choices.of(FATES)
        if fate == "request lost":
            return
        for request in self.slave.receive_data(sent):
            if request.command == slink3.Command.WRITE_TYPED_PARAMETER:
                self.value = request.value
                self.written += 1
                answer = self.slave.answer(request, Reply())
            else:
                answer = self.slave.answer(request, request.found(3, self.value))
            delivered = self._delivered(answer, fate, now + 0.02)
            self._coming += delivered

    def _delivered(self, answer: bytes, fate: str, at: float) -> list[tuple[float, bytes]]:
        if fate == "answer lost":
            return []
        if fate == "late":  # a sequence number that was given up on rests so long
            return [(at + 1.4 + self._choices.word() / 0xFFFF * 1.5, answer)]
        if fate == "twice":
            return [(at, answer), (at + self._choices.word() / 0xFFFF, answer)]
        if fate == "cut":  # what came right behind it could make a frame of it, one time in 256
            self._coming = [item for item in self._coming if abs(item[0] - at) > 0.1]
            return [(at, answer[: 1 + self._choices.to(6)])]
        if fate == "noise":
            return [(at, bytes(self._choices.times(6, no_start)) + answer)]
        return [(at, answer)]

    @property
    def deadline(self) -> float:
        return min((due for due, _ in self._coming), default=math.inf)

    def deliver(self, now: float) -> bytes:
        arrived = sorted(item for item in self._coming if item[0] <= now)
        self._coming = [item for item in self._coming if item[0] > now]
        return b"".join(raw for _, raw in arrived)


def no_start(choices: Choices) -> int:
    byte = choices.byte()
    return 0xFF if byte == 0x01 else byte


FATES = ("well", "well", "request lost", "answer lost", "late", "twice", "cut", "noise")


def converse(
    conversation: Any, session: Session[Any], line: BadLine, now: float
) -> tuple[Any, float]:
    session.drain(line.deliver(now), now)
    exchange = Exchange(conversation, session)
    sent = exchange.start(now)
    while True:
        if sent:
            line.receive(sent, now)
        if exchange.done:
            return exchange, now
        now = max(now, min(exchange.deadline, line.deadline))
        sent = exchange.advance(line.deliver(now), now)


@tried_with(128)
def test_what_a_master_reports_is_true(choices: Choices) -> None:
    """Confirmed is in the slave, what was read is in the slave, and nothing is written too often."""
    role = choices.of((Role.SETTING, Role.COMMAND))
    point = PointDescription("x", "8236:int16", role)
    profile = replace(profile_of("flexmax"), points={"x": point})
    device = PROTOCOLS["slink3"].device(1, profile, {})
    session = Session(slink3.decoder(), slink3.LINE.timing(network=False), echo=False)
    line = BadLine(7, choices)
    now = 10.0
    for asked in choices.times(4, lambda choices: choices.of((None, 0, 1, 2, 3))):
        before = line.written
        if asked is None:
            exchange, now = converse(device.read(device.point("x")), session, line, now)
            with suppress(errors.NoReply):
                assert exchange.result().raw == line.value
            continue
        exchange, now = converse(device.write(device.prepare_write("x", asked)), session, line, now)
        assert line.written - before <= (2 if role is Role.SETTING else 1)
        try:
            record = exchange.result()
        except errors.NoReply:
            assert line.written == before
            continue
        assert record.outcome in (Outcome.CONFIRMED, Outcome.UNKNOWN, Outcome.UNVERIFIED)
        if record.outcome is not Outcome.UNKNOWN:
            assert line.value == asked.to_bytes(2, "little")
