"""Which type a read without one asks for, and what it remembers."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.conversation import Ask
from multidrop.errors import DeviceError
from multidrop.points import Sample
from multidrop.protocols.slink3 import Frame, Response
from multidrop.protocols.slink3.device import Slink3Device, device


def converse(
    conversation: Generator[Any, Frame, Sample], answers: dict[int, tuple[int, bytes]]
) -> tuple[Sample, list[int]]:
    """Play a slave: FORMAT asked for -> (RESPONSE, DATA). Returns the sample and the FORMATs asked."""
    asked = []
    try:
        step = next(conversation)
        while True:
            assert isinstance(step, Ask)
            type_code = step.frame.data[0]
            asked.append(type_code)
            code, data = answers[type_code]
            step = conversation.send(Frame(step.frame.address, 0, 1, code, data))
    except StopIteration as stop:
        return stop.value, asked


def of(profile: str) -> Slink3Device:
    return device(0, load_profile(profile), {})


FOUND = (Response.OK, bytes.fromhex("03 2C 20 D2 04"))


def test_any_drive_is_asked_for_its_own_type_first() -> None:
    sample, asked = converse(of("slink3").read(of("slink3").point("8236")), {0: FOUND})
    assert (sample.value, sample.type, asked) == (1234, "int16", [0])


@pytest.mark.parametrize("refusal", [Response.TYPE_UNKNOWN, Response.TYPE_VALUE_ERROR])
def test_one_that_cannot_name_types_is_asked_for_each(refusal: Response) -> None:
    slave = of("slink3")
    sample, asked = converse(slave.read(slave.point("8236")), {0: (refusal, b""), 3: FOUND})
    assert (sample.value, asked) == (1234, [0, 3])


def test_another_refusal_ends_it() -> None:
    slave = of("slink3")
    with pytest.raises(DeviceError, match="does not exist"):
        converse(slave.read(slave.point("9")), {0: (Response.PARAMETER_NOT_EXIST, b"")})


def test_the_type_that_held_is_asked_for_from_then_on() -> None:
    slave = of("slink3")
    converse(slave.read(slave.point("8236")), {0: FOUND})
    assert converse(slave.read(slave.point("8236")), {3: FOUND})[1] == [3]


def test_auto_always_lets_the_slave_name_it() -> None:
    slave = of("slink3")
    converse(slave.read(slave.point("8236")), {0: FOUND})
    assert converse(slave.read(slave.point("8236:auto")), {0: FOUND})[1] == [0]


def test_a_write_whose_type_a_read_has_shown_asks_for_a_value_not_a_text() -> None:
    slave = of("slink3")
    conversation = slave.write(slave.prepare_write("8236", "1234"))
    answers = iter([FOUND, (Response.OK, b""), FOUND])
    next(conversation)
    try:
        while True:
            conversation.send(Frame(0, 0, 1, *next(answers)))
    except StopIteration as stop:
        record = stop.value
    assert (record.asked, record.outcome.value) == (1234, "confirmed")
