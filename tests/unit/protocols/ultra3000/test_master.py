"""The master: every function as a conversation, refusals, and what is sent once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from multidrop.conversation import Conversation
from multidrop.errors import DeviceError, NoReply, ProtocolError, UsageError
from multidrop.protocols.ultra3000 import Frame, Function, Master
from unit.protocols.ultra3000.wire import Wire

MASTER = Master(0)


def test_reads() -> None:
    wire = Wire({"0730": "00008180", "0116": "0200", "05B007": "FFFE7960", "05BB": "07"})
    assert wire.run(MASTER.read(0x073)) == "00008180"
    assert wire.run(MASTER.read(0x011, function=Function.READ_DEFAULT)) == "0200"
    assert wire.run(MASTER.read(0x05B, 7)) == "FFFE7960"
    assert wire.run(MASTER.read(0x05B, None, Function.READ_INDEX_MAXIMUM)) == "07"
    assert wire.run(MASTER.read_number(0x073, 8)) == 0x8180


def test_a_read_is_repeated() -> None:
    wire = Wire({"0730": [None, None, "00008180"]})
    assert wire.run(MASTER.read(0x073)) == "00008180"
    assert wire.sent == ["0730"] * 3


def test_a_value_of_another_width() -> None:
    with pytest.raises(ProtocolError, match="parameter 073 has 8 digits, 4 came"):
        Wire({"0730": "8180"}).run(MASTER.read_number(0x073, 8))


SENT: list[tuple[str, Callable[[], Conversation[Frame, Any]]]] = [
    ("06D1000186A0", lambda: MASTER.write(0x06D, "000186A0")),
    ("05B307FFFE7960", lambda: MASTER.write(0x05B, "FFFE7960", 7, non_volatile=True)),
    ("06F1", lambda: MASTER.act(0x06F)),
    ("0114", lambda: MASTER.load(0x011)),
    ("0115", lambda: MASTER.save(0x011)),
    ("0117", lambda: MASTER.restore_default(0x011)),
    ("05B707", lambda: MASTER.restore_default(0x05B, 7)),
    ("0731", lambda: MASTER.send(Frame(0, 0x073, 1))),
]


@pytest.mark.parametrize(("body", "service"), SENT)
def test_everything_else_is_sent_once(
    body: str, service: Callable[[], Conversation[Frame, Any]]
) -> None:
    wire = Wire({body: ""})
    wire.run(service())
    assert wire.sent == [body]
    silent = Wire({body: None})
    with pytest.raises(NoReply, match="no reply in 1 attempt"):
        silent.run(service())
    assert silent.sent == [body]


def test_a_write_that_is_answered_with_its_data() -> None:
    body = "06D1000186A0"
    answered = Frame(0, 0x06D, 1, "000186A0").encode()
    Wire({body: answered}).run(MASTER.write(0x06D, "000186A0"))


def test_refusals_are_raised_by_name() -> None:
    wire = Wire({"043105": "!05", "7FF0": "!08", "0110": "!7F"})
    with pytest.raises(DeviceError, match="0005h: above the maximum"):
        wire.run(MASTER.write(0x043, "05"))
    with pytest.raises(DeviceError, match="0008h: invalid function code"):
        wire.run(MASTER.read(0x7FF))
    with pytest.raises(DeviceError, match="unlisted refusal 7Fh") as caught:
        wire.run(MASTER.read(0x011))
    assert caught.value.code == 0x7F


def test_a_broadcast_is_told_to_its_address() -> None:
    wire = Wire()
    wire.run(MASTER.broadcast_write(0x06B, "00"))
    wire.run(Master(0, broadcast=0x80).broadcast_write(0x05B, "00000000", 1, non_volatile=True))
    assert wire.told == ["FF06B100", "8005B30100000000"]
    assert wire.sent == []


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Master(254), "a drive has 0..253"),
        (lambda: Master(0, broadcast=256), "broadcast address 256"),
        (lambda: next(MASTER.read(0x011, function=1)), "function 1h does not read"),
        (lambda: next(MASTER.read(0x800)), "parameter 0x800 is out of range"),
        (lambda: next(MASTER.write(0x011, "0x")), "upper case"),
        (lambda: next(MASTER.write(0x05B, "00", 256)), "element 256"),
    ],
)
def test_what_cannot_be_said(make: Callable[[], object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        make()
