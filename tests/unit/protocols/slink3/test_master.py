"""What a master refuses to say; what it says is in the dialogues."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from multidrop.conversation import Ask, Tell
from multidrop.errors import UsageError
from multidrop.protocols.slink3 import AX_V, FLEXMAX, Format, Frame, Master


@pytest.mark.parametrize("address", [-1, 128, 255])
def test_addresses_that_no_slave_has(address: int) -> None:
    with pytest.raises(UsageError, match=r"a slave has 0\.\.127"):
        Master(address)


@pytest.mark.parametrize(
    ("conversation", "message"),
    [
        (lambda master: master.read_typed(65536), "index 65536 is out of range"),
        (lambda master: master.read_typed(1, subindex=256), "subindex 256 is out of range"),
        (
            lambda master: master.read_typed(1, destination=8),
            r"destination 8 is out of range: 0\.\.7",
        ),
        (lambda master: master.command(0x23, destination=-1), "destination -1 is out of range"),
        (lambda master: master.command(0x10000), "command or response 65536 is out of range"),
        (lambda master: master.command(0x27, bytes(248)), "248 bytes of data are too many"),
        (lambda master: master.write_typed(1, Format.VOID, 1), "a write needs a type"),
        (lambda master: master.write_typed(1, Format.CHAR, 128), "128 does not fit int8"),
        (lambda master: master.write_standard(1, 256, Format.CHAR, 1), "subindex 256"),
        (lambda master: master.broadcast_typed(1, Format.VOID, 1), "no value of type auto"),
        (lambda master: master.broadcast_standard(1, 0, Format.CHAR, 128), "128 does not fit int8"),
    ],
)
def test_what_cannot_be_said_is_refused_at_the_first_step(
    conversation: Callable[[Master], Any], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        next(conversation(Master(1)))


@pytest.mark.parametrize(
    "conversation",
    [
        lambda master: master.read_typed(1, Format.SHORT_INT, 1),
        lambda master: master.write_typed(1, Format.SHORT_INT, 1, 1),
        lambda master: master.broadcast_typed(1, Format.SHORT_INT, 1, 1),
    ],
)
def test_a_dialect_without_subindex(conversation: Callable[[Master], Any]) -> None:
    with pytest.raises(UsageError, match="ax-v has no subindex"):
        next(conversation(Master(1, AX_V)))


def test_a_master_for_what_is_behind_sends_everything_there() -> None:
    master = Master(1, FLEXMAX, destination=2)
    assert next(master.status_word()) == Ask(Frame(1, order=4, code=0x23), repeatable=True)
    assert next(master.read_typed(1, Format.CHAR, destination=0)) == Ask(
        Frame(1, code=0x26, data=b"\x02\x01\x00"), repeatable=True
    )


@pytest.mark.parametrize(
    ("conversation", "repeatable"),
    [
        (lambda master: master.read_typed(1), True),
        (lambda master: master.read_standard(1), True),
        (lambda master: master.status_word(), True),
        (lambda master: master.malfunction_code(), True),
        (lambda master: master.broadcast_verify(), True),
        (lambda master: master.write_typed(1, Format.CHAR, 1), False),
        (lambda master: master.write_typed(1, Format.CHAR, 1, repeatable=True), False),
        (lambda master: master.write_standard(1, 0, Format.CHAR, 1, repeatable=True), False),
        (lambda master: master.reset(), False),
        (lambda master: master.special_access(b""), False),
        (lambda master: master.command(0x26, b"\x03\x01\x00"), False),
    ],
)
def test_only_reads_may_be_asked_twice_when_no_answer_comes(
    conversation: Callable[[Master], Any], repeatable: bool
) -> None:
    step = next(conversation(Master(1)))
    assert isinstance(step, Ask)
    assert step.repeatable is repeatable


def test_a_broadcast_is_told() -> None:
    step = next(Master(1, AX_V).broadcast_typed(1111, Format.SHORT_INT, 200))
    assert step == Tell(Frame(128, code=0x27, data=bytes.fromhex("03 57 04 C8 00")))
