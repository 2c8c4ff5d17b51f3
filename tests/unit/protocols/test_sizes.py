"""What a read takes on the wire is known before it is sent."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.conversation import Ask
from multidrop.device import Device, Sizes
from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000


def device(profile: str) -> Device:
    found = load_profile(profile)
    return PROTOCOLS[found.protocol].device(1, found, {})


QUESTIONS = [
    ("slink3", "8236:int16"),
    ("slink3", "8236.1:int32"),
    ("slink3", "dest3/511.2:bool"),
    ("slink3", "std/0x6041.0:uint16"),
    ("ultra3000", "0x06D"),
    ("53sl6000", "H1"),
    ("53mc5000", "mem/0x100/32"),
]


@pytest.mark.parametrize(("profile", "text"), QUESTIONS)
def test_the_question(profile: str, text: str) -> None:
    asked = device(profile)
    point = asked.point(text)
    step = next(asked.read_group([point]))
    assert isinstance(step, Ask)
    (sizes,) = asked.sizes([point])
    assert sizes.question == len(step.frame.encode())


ANSWERS = [
    ("slink3", "8236:int16", slink3.Frame(1, 0, 1, 0, bytes(3 + 2))),
    ("slink3", "8236.1:int32", slink3.Frame(1, 0, 1, 0, bytes(4 + 4))),
    ("slink3", "8236:bool", slink3.Frame(1, 0, 1, 0, bytes(3 + 1))),
    ("slink3", "std/0x6041.0:uint16", slink3.Frame(1, 0, 1, 0, bytes(3 + 2))),
    ("ultra3000", "setpoint_velocity", ultra3000.Frame(1, 0x6D, 0, "0" * 8)),
    ("ultra3000", "0x05B.7", ultra3000.Frame(1, 0x5B, 0, "07" + "0" * 8)),
    ("53sl6000", "H1", datalink.Frame(datalink.Command.RESPONSE, 1, 0x9D4, 5, bytes(5))),
]


@pytest.mark.parametrize(("profile", "text", "answer"), ANSWERS)
def test_the_answer(
    profile: str, text: str, answer: slink3.Frame | datalink.Frame | ultra3000.Frame
) -> None:
    asked = device(profile)
    (sizes,) = asked.sizes([asked.point(text)])
    assert sizes.answer == len(answer.encode())


def test_points_that_one_message_reads() -> None:
    asked = device("53mc5000")
    (group,) = asked.plan([*asked.points("C100..C103")])
    assert asked.sizes(group) == [Sizes(6, 6 + 4 * 3)]


def test_memory_that_takes_several_messages() -> None:
    asked = device("53mc5000")
    assert asked.sizes([asked.point("mem/0x100/70")]) == [
        Sizes(6, 38),
        Sizes(6, 38),
        Sizes(6, 12),
    ]


@pytest.mark.parametrize(("text", "answer"), [("8236", 15), ("8236:string", 15)])
def test_a_width_that_nobody_knows_is_assumed(text: str, answer: int) -> None:
    asked = device("slink3")
    assert asked.sizes([asked.point(text)]) == [Sizes(11, answer)]


def test_a_type_that_a_read_has_shown() -> None:
    asked = device("ax-v")
    point = asked.point("1009")
    reading = asked.read(point)
    frame = next(reading).frame  # type: ignore[union-attr]
    answer = slink3.Frame(1, frame.control, 1, 0, bytes.fromhex("03 F1 03 7D 00"))
    with pytest.raises(StopIteration):
        reading.send(answer)
    assert asked.sizes([point]) == [Sizes(11, len(answer.encode()))]
