"""What a slave does, row by row of the protocol's table, for each dialect."""

from __future__ import annotations

import pytest

from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.protocols.slink3 import AX_V, DGFC386, FLEXMAX, SLINK3, Dialect, Format, Frame, Slave
from multidrop.protocols.slink3.dialects import DIALECTS
from multidrop.protocols.slink3.messages import (
    WRITES,
    Response,
    StandardParameter,
    TypedParameter,
)
from multidrop.protocols.slink3.slave import Reply, Request

ADDRESS = 5
SILENT = None


class Drive:
    """A device with a short int 8236, -100..100, a read-only 8237 and a status word."""

    def __init__(self) -> None:
        self.value = b"\x64\x00"
        self.done: list[int] = []

    def respond(self, request: Request) -> Reply:
        self.done.append(request.command)
        asked = request.parameter
        if asked is None:
            return Reply(data=request.value if request.command == 0xABCD else b"\x37\x02")
        if asked.index not in (8236, 8237) or (asked.subindex or 0) > 0:
            return Reply(Response.PARAMETER_NOT_EXIST)
        if isinstance(asked, TypedParameter) and asked.type_code not in (0, 3):
            return Reply(Response.TYPE_VALUE_ERROR)
        if request.command not in WRITES:
            return request.found(Format.SHORT_INT, self.value)
        if asked.index == 8237:
            return Reply(Response.READ_ONLY_PARAMETER)
        value = int.from_bytes(request.value, "little", signed=True)
        if abs(value) > 100:
            return Reply(Response.ABOVE_MAXIMUM if value > 0 else Response.BELOW_MINIMUM)
        self.value = request.value
        return Reply()


def serve(slave: Slave, drive: Drive, raw: bytes) -> list[Frame]:
    """The slave's answers to bytes that the line falls silent after."""
    answers = [
        slave.answer(request, request.settled or drive.respond(request))
        for request in slave.receive_data(raw) + slave.silence()
    ]
    return [Frame.decode(answer) for answer in answers if answer]


def said(dialect: Dialect, frame: Frame | bytes, **given: bool) -> int | None:
    """The RESPONSE to a request, None for silence."""
    slave = Slave(ADDRESS, dialect, **given)
    raw = frame if isinstance(frame, bytes) else frame.encode()
    answers = serve(slave, Drive(), raw)
    assert len(answers) < 2
    return answers[0].code if answers else SILENT


def request(code: int, data: str = "", *, address: int = ADDRESS, order: int = 0) -> Frame:
    return Frame(address, 0x14, order, code, bytes.fromhex(data))


READ, WRITE = request(0x26, "03 2C 20"), request(0x27, "03 2C 20 05 00")
BROADCAST, BROADCAST_AX_V = WRITE._replace(address=255), WRITE._replace(address=128)

DUTIES: list[tuple[str, Frame, dict[str, int | None]]] = [
    # case, request, RESPONSE of flexmax, dgfc386, ax-v, slink3
    (title, frame, dict(zip(("flexmax", "dgfc386", "ax-v", "slink3"), answers, strict=True)))
    for title, frame, *answers in [
        ("read", READ, 0, 0, 0, 0),
        ("write", WRITE, 0, 0, 0, 0),
        ("another address", READ._replace(address=6), None, None, None, None),
        ("an answer of another slave", READ._replace(order=1), None, None, None, None),
        ("no such destination", READ._replace(order=2 << 1), 0x10, 0x10, 0x97, 0x10),
        ("a destination nobody has", READ._replace(order=7 << 1), 0x10, 0x10, 0x97, 0x10),
        ("read without INDEX", request(0x26, "03"), 0xFD, 0xFD, 0x97, 0xFD),
        ("read without DATA", request(0x26), 0xFD, 0xFD, 0x97, 0xFD),
        ("read with a VALUE", request(0x26, "03 2C 20 00 00"), 0xFD, 0xFD, 0x97, 0xFD),
        ("read, SUBINDEX missing", request(0x26, "83 2C 20"), 0xFD, 0xFD, 0x97, 0xFD),
        ("read with SUBINDEX", request(0x26, "83 2C 20 00"), 0, 0, 0x97, 0),
        ("write, VALUE too short", request(0x27, "03 2C 20 05"), 0xFD, 0xFD, 0x97, 0xFD),
        ("write, VALUE too long", request(0x27, "03 2C 20 05 00 00"), 0xFD, 0xFD, 0x97, 0xFD),
        ("write without VALUE", request(0x27, "03 2C 20"), 0xFD, 0xFD, 0x97, 0xFD),
        ("status word with DATA", request(0x23, "00"), 0xFD, 0x18, 0x18, 0xFD),
        ("malfunction code with DATA", request(0x2F, "00"), 0xFD, 0x18, 0x18, 0xFD),
        ("reset with DATA", request(0x20, "00"), 0xFD, 0x18, 0x18, 0xFD),
        ("verify with DATA", request(0x28, "00"), 0xFD, 0x18, 0x18, 0xFD),
        ("read standard, no SUBINDEX", request(0x24, "2C 20"), 0xFD, 0x18, 0x18, 0xFD),
        ("read standard with VALUE", request(0x24, "2C 20 00 00"), 0xFD, 0x18, 0x18, 0xFD),
        ("write standard, no VALUE", request(0x25, "2C 20 00"), 0xFD, 0x18, 0x18, 0xFD),
        ("read standard", request(0x24, "2C 20 00"), 0, 0x18, 0x18, 0),
        ("write standard", request(0x25, "2C 20 00 05 00"), 0, 0x18, 0x18, 0),
        ("status word", request(0x23), 0, 0x18, 0x18, 0),
        ("malfunction code", request(0x2F), 0, 0x18, 0x18, 0),
        ("reset", request(0x20), 0, 0x18, 0x18, 0),
        ("verify", request(0x28), 0xFF, 0x18, 0x18, 0xFF),
        ("special access", request(0xABCD, "11 22"), 0x18, 0, 0x18, 0),
        ("a command that nobody implements", request(0x29), 0x18, 0x18, 0x18, 0x18),
        ("a command without a name", request(0x0123), 0x18, 0x18, 0x18, 0x18),
        ("unknown INDEX", request(0x26, "03 01 00"), 1, 1, 1, 1),
        ("unknown SUBINDEX", request(0x26, "83 2C 20 01"), 1, 1, 0x97, 1),
        ("a type of nobody", request(0x26, "0A 2C 20"), 0x1E, 0x1E, 0x1E, 0x1E),
        ("a type without a name", request(0x26, "1F 2C 20"), 0x1E, 0x1E, 0x1E, 0x1E),
        ("string", request(0x26, "09 2C 20"), 6, 0x1E, 0x1E, 6),
        ("char", request(0x26, "02 2C 20"), 0x1E, 6, 0x1E, 6),
        ("boolean", request(0x26, "01 2C 20"), 0x1E, 6, 0x1E, 6),
        ("another type of the dialect", request(0x26, "04 2C 20"), 6, 6, 0x1E, 6),
        ("read void", request(0x26, "00 2C 20"), 0x1E, 0, 0, 0),
        ("write void", request(0x27, "00 2C 20 05 00"), 0x1E, 0x1E, 0x1E, 0x1E),
        ("above the maximum", request(0x27, "03 2C 20 65 00"), 0x12, 0x12, 0x97, 0x12),
        ("below the minimum", request(0x27, "03 2C 20 00 80"), 0x13, 0x13, 0x97, 0x13),
        ("read-only", request(0x27, "03 2D 20 05 00"), 0x19, 0x19, 0x97, 0x19),
        ("reserved bits of ORDER", READ._replace(order=0xE0), 0, 0, 0, 0),
        ("the fault bit of a request", READ._replace(order=0x10), 0, 0, 0, 0),
    ]
]


@pytest.mark.parametrize("dialect", DIALECTS.values(), ids=lambda dialect: dialect.name)
@pytest.mark.parametrize(
    ("frame", "answers"), [row[1:] for row in DUTIES], ids=[r[0] for r in DUTIES]
)
def test_duty(frame: Frame, answers: dict[str, int | None], dialect: Dialect) -> None:
    assert said(dialect, frame) == answers[dialect.name]


@pytest.mark.parametrize(
    "raw",
    [
        READ.encode()[:-1] + b"\x00",  # checksum
        READ.encode()[:-1],  # cut short
        READ.encode()[:5],  # no more than ORDER
        b"\x01\x05\x14\x07\x00\x26\x00",  # LENGTH under 8
    ],
)
@pytest.mark.parametrize("dialect", DIALECTS.values(), ids=lambda dialect: dialect.name)
def test_damage_gets_silence_or_0097_where_that_was_chosen(dialect: Dialect, raw: bytes) -> None:
    assert said(dialect, raw) is SILENT
    assert said(dialect, raw, answer_damage=True) == 0x97


@pytest.mark.parametrize(
    "raw",
    [
        READ._replace(address=6).encode()[:-1],  # another address, as far as one can tell
        READ._replace(order=1).encode()[:-1],  # an answer
        READ.encode()[:4],  # no ORDER to look at
        b"\xff\x05\x14\x08\x00\x26\x00",  # no START
    ],
)
def test_damage_of_others_gets_silence_even_then(raw: bytes) -> None:
    assert said(FLEXMAX, raw, answer_damage=True) is SILENT


def test_the_answer_to_damage_repeats_what_could_be_read() -> None:
    slave = Slave(ADDRESS, FLEXMAX, answer_damage=True)
    (answer,) = serve(slave, Drive(), READ._replace(control=0x3C, order=0xE4).encode()[:-1])
    assert answer == Frame(ADDRESS, 0x3C, 0x05, 0x97)


def test_an_answer_repeats_address_number_and_destination() -> None:
    slave = Slave(ADDRESS, FLEXMAX, option=True)
    frame = READ._replace(control=0x3F, order=0xE4)
    (answer,) = serve(slave, Drive(), frame.encode())
    assert (answer.address, answer.control, answer.order) == (ADDRESS, 0x3F, 0x05)
    (refusal,) = serve(slave, Drive(), frame._replace(code=0x29).encode())
    assert (refusal.address, refusal.control, refusal.order) == (ADDRESS, 0x3F, 0x05)


def test_every_answer_carries_the_fault_bit_but_an_ax_vs() -> None:
    for dialect, order in ((FLEXMAX, 0x11), (DGFC386, 0x11), (SLINK3, 0x11), (AX_V, 0x01)):
        slave = Slave(ADDRESS, dialect)
        slave.fault = True
        orders = [serve(slave, Drive(), frame.encode())[0].order for frame in (READ, request(0x29))]
        assert orders == [order, order], dialect.name


def test_the_fault_of_what_is_behind_is_its_own() -> None:
    slave = Slave(ADDRESS, FLEXMAX, option=True)
    slave.fault = True
    assert serve(slave, Drive(), READ._replace(order=4).encode())[0].order == 0x05
    slave.fault, slave.fault_behind = False, True
    assert serve(slave, Drive(), READ._replace(order=4).encode())[0].order == 0x15
    assert serve(slave, Drive(), READ.encode())[0].order == 0x01


def test_behind_a_drive_the_card_decides() -> None:
    """Void, which a FlexMax has not; no status word, which a DGFC386 has not."""
    slave = Slave(ADDRESS, FLEXMAX, option=True)
    assert serve(slave, Drive(), request(0x26, "00 2C 20", order=4).encode())[0].code == 0
    assert serve(slave, Drive(), request(0x23, order=4).encode())[0].code == 0x18
    assert serve(slave, Drive(), request(0x28, order=4).encode())[0].code == 0x18
    assert serve(slave, Drive(), request(0x26, "00 2C 20", order=6).encode())[0].code == 0x10


def test_behind_a_card_the_drive_decides() -> None:
    slave = Slave(ADDRESS, DGFC386, option=True)
    assert serve(slave, Drive(), request(0x23, order=4).encode())[0].code == 0
    assert serve(slave, Drive(), request(0x23).encode())[0].code == 0x18


def test_nothing_is_behind_an_ax_v() -> None:
    assert Slave(ADDRESS, AX_V, option=True).behind is None


# -- broadcasts --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dialect", "frame", "command"),
    [
        (FLEXMAX, BROADCAST, 0x27),
        (FLEXMAX, request(0x25, "2C 20 00 05 00", address=255), 0x25),
        (FLEXMAX, request(0x20, address=255), 0x20),
        (DGFC386, BROADCAST, 0x27),
        (AX_V, BROADCAST_AX_V, 0x27),
        (SLINK3, BROADCAST, 0x27),
    ],
)
def test_a_broadcast_is_carried_out_and_not_answered(
    dialect: Dialect, frame: Frame, command: int
) -> None:
    slave, drive = Slave(ADDRESS, dialect), Drive()
    assert serve(slave, drive, frame.encode()) == []
    assert drive.done == [command]


@pytest.mark.parametrize(
    ("dialect", "frame"),
    [
        (FLEXMAX, READ._replace(address=255)),
        (FLEXMAX, request(0x23, address=255)),
        (FLEXMAX, request(0x28, address=255)),
        (FLEXMAX, BROADCAST._replace(order=4)),
        (FLEXMAX, BROADCAST._replace(order=1)),
        (FLEXMAX, BROADCAST_AX_V),
        (AX_V, BROADCAST),
        (FLEXMAX, request(0x27, "00 2C 20 05 00", address=255)),  # void
        (FLEXMAX, request(0x27, "03 2C 20 05", address=255)),  # VALUE too short
        (AX_V, request(0x20, address=128)),
    ],
)
def test_a_broadcast_of_anything_else_does_nothing(dialect: Dialect, frame: Frame) -> None:
    slave, drive = Slave(ADDRESS, dialect), Drive()
    assert serve(slave, drive, frame.encode()) == []
    assert drive.done == []


def verified(slave: Slave) -> int:
    return serve(slave, Drive(), request(0x28).encode())[0].code


def test_verify_says_whether_a_broadcast_was_received() -> None:
    slave = Slave(ADDRESS, FLEXMAX)
    assert verified(slave) == 0xFF
    serve(slave, Drive(), BROADCAST.encode())
    assert verified(slave) == 0x81
    assert verified(slave) == 0x81, "a lost answer can be asked for again"


def test_received_is_not_applied() -> None:
    """A value out of range, or of the wrong width, is received too."""
    for data in ("03 2C 20 FF 7F", "03 2C 20 05", "00 2C 20 05 00"):
        slave = Slave(ADDRESS, FLEXMAX)
        serve(slave, Drive(), request(0x27, data, address=255).encode())
        assert verified(slave) == 0x81


@pytest.mark.parametrize(
    "other",
    [READ, request(0x23), request(0x29), READ._replace(order=4), request(0x20)],
    ids=["read", "status word", "unknown command", "behind", "reset"],
)
def test_any_other_command_to_this_address_clears_it(other: Frame) -> None:
    slave = Slave(ADDRESS, FLEXMAX)
    serve(slave, Drive(), BROADCAST.encode())
    serve(slave, Drive(), other.encode())
    assert verified(slave) == 0xFF


@pytest.mark.parametrize(
    "other",
    [READ._replace(address=6), READ._replace(order=1), READ._replace(address=255)],
    ids=["another address", "an answer", "a broadcast that does nothing"],
)
def test_what_is_not_for_this_address_does_not(other: Frame) -> None:
    slave = Slave(ADDRESS, FLEXMAX)
    serve(slave, Drive(), BROADCAST.encode())
    serve(slave, Drive(), other.encode())
    assert verified(slave) == 0x81


def test_reset_forgets_half_a_frame() -> None:
    slave = Slave(ADDRESS, FLEXMAX)
    (reset,) = slave.receive_data(request(0x20).encode() + READ.encode()[:5])
    assert slave.answer(reset, Reply()) == request(0)._replace(order=1).encode()
    assert slave.receive_data(READ.encode()[5:]) == []
    slave.silence()
    assert len(slave.receive_data(READ.encode())) == 1


def test_reset_forgets_a_broadcast_that_came_before_its_answer() -> None:
    slave = Slave(ADDRESS, FLEXMAX)
    reset, _ = slave.receive_data(request(0x20).encode() + BROADCAST.encode())
    slave.answer(reset, Reply())
    assert verified(slave) == 0xFF


def test_a_reset_that_the_device_refuses_forgets_nothing() -> None:
    slave = Slave(ADDRESS, FLEXMAX)
    (reset,) = slave.receive_data(request(0x20).encode() + READ.encode()[:5])
    slave.answer(reset, Reply(Response.STATE_NOT_CORRECT))
    assert len(slave.receive_data(READ.encode()[5:])) == 1


# -- requests and replies ------------------------------------------------------------------------


def test_what_a_request_holds() -> None:
    slave = Slave(ADDRESS, SLINK3, option=True)
    typed, standard, special = slave.receive_data(
        request(0x27, "83 2C 20 01 05 00", order=4).encode()
        + request(0x24, "41 60 00").encode()
        + request(0xABCD, "11 22").encode()
    )
    assert typed.parameter == TypedParameter(3, 8236, 1)
    assert (typed.command, typed.destination, typed.value) == (0x27, 2, b"\x05\x00")
    assert standard.parameter == StandardParameter(0x6041, 0)
    assert special.value == b"\x11\x22"
    assert typed.settled is standard.settled is special.settled is None


def test_the_ok_of_a_read_repeats_what_was_asked_and_names_the_type() -> None:
    slave = Slave(ADDRESS, SLINK3)
    typed, standard = slave.receive_data(
        request(0x26, "80 2C 20 01").encode() + request(0x24, "41 60 02").encode()
    )
    assert typed.found(Format.SHORT_INT, b"\x05\x00").data == bytes.fromhex("83 2C 20 01 05 00")
    assert standard.found(Format.SHORT_INT, b"\x05\x00").data == bytes.fromhex("41 60 02 05 00")


def test_only_an_ok_and_special_access_carry_data() -> None:
    slave = Slave(ADDRESS, SLINK3)
    read, special = slave.receive_data(READ.encode() + request(0xABCD, "11").encode())
    assert Frame.decode(slave.answer(read, Reply(1, b"x"))).data == b""
    assert Frame.decode(slave.answer(special, Reply(1, b"x"))).data == b"x"


def test_a_code_without_a_meaning_goes_out_as_it_is() -> None:
    slave = Slave(ADDRESS, AX_V)
    (read,) = slave.receive_data(READ.encode())
    assert Frame.decode(slave.answer(read, Reply(0x1234))).code == 0x1234


def test_events_of_a_decoder_that_serves_a_whole_line() -> None:
    slave = Slave(ADDRESS, FLEXMAX)
    events: list[FrameReceived[Frame] | Damaged] = [
        FrameReceived(READ._replace(address=6), b""),
        Damaged(b"\x00", "no START"),
        FrameReceived(READ, b""),
    ]
    assert [item.frame for item in slave.receive_events(events)] == [READ]


@pytest.mark.parametrize("address", [0, 127])
def test_the_first_and_the_last_address(address: int) -> None:
    assert len(serve(Slave(address), Drive(), READ._replace(address=address).encode())) == 1


@pytest.mark.parametrize("address", [-1, 128, 255])
def test_addresses_that_no_slave_has(address: int) -> None:
    with pytest.raises(UsageError, match=r"a slave has 0\.\.127"):
        Slave(address)
