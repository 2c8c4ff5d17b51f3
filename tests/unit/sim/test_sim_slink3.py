"""Simulated FlexMax, AX-V and DGFC386: the documents' examples, refusals, a card and its drive."""

from __future__ import annotations

import pytest

from multidrop.errors import DeviceError, NoReply, UsageError
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import AX_V, DGFC386, FLEXMAX, Format, Frame, Master, State
from multidrop.sim.devices import simulated_device
from multidrop.sim.slink3 import TRIP, FlexMax, Parameter, Parameters, SimulatedSlave, dgfc386
from unit.sim.wires import Wire, exchanged, plant, simulated

WORD, INT, BYTE = Format.UNSIGNED_SHORT_INT, Format.SHORT_INT, Format.UNSIGNED_CHAR


@pytest.fixture
def wire() -> Wire:
    return Wire(simulated())


DRIVE, CARD, AX = Master(0, FLEXMAX), Master(0, FLEXMAX, destination=2), Master(2, AX_V)


@pytest.mark.parametrize(
    ("request_bytes", "answer_bytes"),
    [
        ("01 00 3C 0D 00 27 00 03 57 04 C8 00 8E", "01 00 3C 08 01 00 00 35"),
        ("01 02 00 0B 00 26 00 00 F1 03 DD", "01 02 00 0D 01 00 00 03 F1 03 7D 00 82"),
        ("01 00 00 0D 00 27 00 03 2C 20 D2 04 F3", "01 00 00 08 01 00 00 09"),
    ],
    ids=["IPA 1111 := 200", "IPA 1009 = 125", "8236 := 1234"],
)
def test_the_documents_examples_byte_for_byte(request_bytes: str, answer_bytes: str) -> None:
    request, answer = (bytes.fromhex(text) for text in (request_bytes, answer_bytes))
    profile = "flexmax" if "2C 20" in request_bytes else "ax-v"
    line = simulated([simulated_device(profile, request[1])])
    end = line.attach()
    end.receive(request, 0.0)
    assert end.send(0.0) == answer


def test_8236_gives_back_what_it_took(wire: Wire) -> None:
    wire.run(DRIVE.write_typed(8236, INT, 1234))
    assert wire.run(DRIVE.read_typed(8236, INT)).value == 1234


def test_the_addresses_are_parameters(wire: Wire) -> None:
    assert wire.run(DRIVE.read_typed(8511, WORD)).value == 0
    assert wire.run(Master(1).read_typed(8511, WORD)).value == 1
    assert wire.run(CARD.read_typed(511, BYTE)).value == 0


def test_a_new_address_holds_from_the_answer_on(wire: Wire) -> None:
    """The write is answered from the old address; from then on the slave is at the new one."""
    assert not wire.run(DRIVE.write_typed(8511, WORD, 5)).submitted
    with pytest.raises(NoReply):
        wire.run(DRIVE.read_typed(8511, WORD))
    assert wire.run(Master(5).read_typed(8511, WORD)).value == 5
    assert wire.run(Master(5, destination=2).read_typed(511, BYTE)).value == 0


def test_the_address_of_a_card_that_is_wired_directly() -> None:
    wire = Wire(simulated([dgfc386(3)]))
    wire.run(Master(3, DGFC386).write_typed(511, BYTE, 9))
    with pytest.raises(NoReply):
        wire.run(Master(3, DGFC386).read_typed(511))
    assert wire.run(Master(9, DGFC386).read_typed(511)).value == 9


@pytest.mark.parametrize(
    ("index", "type_code", "value", "code"),
    [
        (8511, WORD, 128, 0x0012),
        (9999, INT, 1, 0x0001),
        (8236, WORD, 1, 0x0006),
        (8236, Format.BOOLEAN, 1, 0x001E),
        (0x6041, WORD, 1, 0x0019),
        (0x6042, INT, 3001, 0x0012),
        (0x6042, INT, -3001, 0x0013),
    ],
)
def test_what_a_flexmax_refuses(
    wire: Wire, index: int, type_code: Format, value: int, code: int
) -> None:
    with pytest.raises(DeviceError) as caught:
        wire.run(DRIVE.write_typed(index, type_code, value))
    assert caught.value.code == code


@pytest.mark.parametrize("code", [0x0020, 0x0023, 0x0024, 0x0025, 0x0028, 0x002F, 0xABCD, 0x0029])
def test_commands_that_an_ax_v_has_not(code: int) -> None:
    (answer,) = exchanged(simulated(), Frame(2, 0, 0, code, b""))
    assert answer.code == 0x0018


def test_what_an_ax_v_refuses(wire: Wire) -> None:
    for index, type_code, code in ((1, INT, 0x0001), (1009, WORD, 0x001E), (1009, BYTE, 0x001E)):
        with pytest.raises(DeviceError) as caught:
            wire.run(AX.read_typed(index, type_code))
        assert caught.value.code == code


def test_a_subindex_is_part_of_the_parameter(wire: Wire) -> None:
    with pytest.raises(DeviceError, match="parameter does not exist"):
        wire.run(DRIVE.read_typed(8236, INT, 1))
    assert wire.run(DRIVE.read_typed(8236, INT, 0)).value == 0


def test_a_standard_parameter_of_the_wrong_width(wire: Wire) -> None:
    for type_code in (BYTE, Format.LONG_INT):
        with pytest.raises(DeviceError) as caught:
            wire.run(DRIVE.write_standard(0x6042, 0, type_code, 1))
        assert caught.value.code == 0x00FD
    wire.run(DRIVE.write_standard(0x6042, 0, INT, 1))
    assert wire.run(DRIVE.read_standard(0x6042, 0, INT)).value == 1


def test_limits_of_a_parameter() -> None:
    limited = Parameter(INT, 5, minimum=-10, maximum=10)
    assert limited.write(b"\x0a\x00", 0.0) == slink3.Response.OK
    assert limited.write(b"\x0b\x00", 0.0) == slink3.Response.ABOVE_MAXIMUM
    assert limited.write(b"\xf5\xff", 0.0) == slink3.Response.BELOW_MINIMUM
    assert limited.read(0.0) == b"\x0a\x00"


def test_a_string_parameter() -> None:
    device = SimulatedSlave(4, FLEXMAX, Parameters({(1, 0): Parameter(Format.STRING, "FlexMax")}))
    wire = Wire(simulated([device]))
    assert wire.run(Master(4).read_typed(1, Format.STRING)).value == "FlexMax"
    wire.run(Master(4).write_typed(1, Format.STRING, "Größe"))
    assert device.parameters.known[(1, 0)].value == "Größe"


def test_a_drive_runs_and_coasts_by_its_standard_parameters(wire: Wire) -> None:
    def control(word: int) -> State:
        wire.run(DRIVE.write_standard(0x6040, 0, WORD, word))
        return wire.run(DRIVE.status_word()).state

    assert control(0x06) is State.READY_TO_SWITCH_ON
    assert control(0x07) is State.SWITCHED_ON
    assert control(0x0F) is State.OPERATION_ENABLED
    wire.run(DRIVE.write_standard(0x6042, 0, INT, 1000))
    wire.wait(1.0)
    assert wire.run(DRIVE.read_standard(0x6044, 0, INT)).value == pytest.approx(500, abs=5)
    wire.wait(2.0)
    assert wire.run(DRIVE.read_standard(0x6044, 0, INT)).value == 1000
    assert control(0x00) is State.SWITCH_ON_DISABLED  # 0000h on a running drive: it coasts
    wire.wait(1.0)
    assert wire.run(DRIVE.read_standard(0x6044, 0, INT)).value == pytest.approx(900, abs=5)


def test_a_fault_shows_in_every_answer_until_it_is_cleared(wire: Wire) -> None:
    assert not wire.run(DRIVE.read_typed(8236, INT)).fault
    wire.run(DRIVE.write_typed(TRIP, WORD, 0x2310))
    assert wire.run(DRIVE.read_typed(8236, INT)).fault
    assert wire.run(DRIVE.status_word()).state is State.FAULT
    found = wire.run(DRIVE.malfunction_code())
    assert (found.code, found.fault, found.family) == (0x2310, True, "current")
    with pytest.raises(DeviceError) as caught:
        wire.run(DRIVE.read_typed(9999, INT))
    assert caught.value.fault
    for word in (0x0000, 0x0080, 0x0000):
        wire.run(DRIVE.write_standard(0x6040, 0, WORD, word))
    assert not wire.run(DRIVE.status_word()).fault
    assert wire.run(DRIVE.malfunction_code()).code == 0
    assert not wire.run(Master(1).status_word()).fault


def test_an_ax_v_has_no_fault_bit() -> None:
    (answer,) = exchanged(simulated(), Frame(2, 0, 0, 0x26, b"\x00\xf1\x03"))
    assert not answer.in_fault


def test_special_access_goes_to_the_card_and_comes_back_unchanged(wire: Wire) -> None:
    assert wire.run(CARD.special_access(bytes(range(247)))) == bytes(range(247))
    assert wire.run(CARD.special_access(b"")) == b""
    with pytest.raises(DeviceError, match="unknown command"):
        wire.run(DRIVE.special_access(b"\x01"))


def test_a_drive_without_a_card(wire: Wire) -> None:
    with pytest.raises(DeviceError, match="destination option does not exist"):
        wire.run(Master(1, destination=2).read_typed(511, BYTE))
    with pytest.raises(DeviceError) as caught:
        wire.run(Master(2, AX_V, destination=2).read_typed(511, INT))
    assert caught.value.code == 0x0097


@pytest.fixture
def behind() -> Wire:
    """A card that is wired directly, and its drive behind it."""
    return Wire(simulated([simulated_device("dgfc386", 4, "flexmax")]))


def test_a_card_that_is_wired_directly(behind: Wire) -> None:
    card = Master(4, DGFC386)
    assert behind.run(card.read_typed(511)).type_code == BYTE
    assert behind.run(card.special_access(b"\xff\x01")) == b"\xff\x01"
    with pytest.raises(DeviceError, match="unknown command"):
        behind.run(card.status_word())


def test_the_drive_behind_a_card_answers_every_service(behind: Wire) -> None:
    drive = Master(4, DGFC386, destination=2)
    behind.run(drive.write_typed(8236, INT, -7))
    assert behind.run(drive.read_typed(8236, INT)).value == -7
    behind.run(drive.write_standard(0x6040, 0, WORD, 0x06))
    assert behind.run(drive.command(0x23)).data[:1] == b"\x31"  # ready to switch on
    assert behind.run(drive.command(0x2F)).data == b"\x00\x00"
    assert behind.run(drive.command(0x20)).code == 0


def test_the_fault_of_a_drive_behind_a_card_is_in_its_answers_alone(behind: Wire) -> None:
    drive, card = Master(4, DGFC386, destination=2), Master(4, DGFC386)
    behind.run(drive.write_typed(TRIP, WORD, 0x3210))
    assert behind.run(drive.read_typed(8236, INT)).fault
    assert not behind.run(card.read_typed(511)).fault


def test_the_answers_carry_their_destination() -> None:
    line = simulated()
    for order, expected in ((0x00, 0x01), (0x04, 0x05)):
        index = b"\x05\xff\x01" if order else b"\x03\x2c\x20"
        (answer,) = exchanged(line, Frame(0, 0, order, 0x26, index))
        assert answer.order == expected


def test_broadcasts_reach_every_slave_of_the_dialect(wire: Wire) -> None:
    wire.run(DRIVE.status_word())
    assert not wire.run(DRIVE.broadcast_verify())
    wire.run(DRIVE.broadcast_typed(8236, INT, 55))
    for address in (0, 1):
        assert wire.run(Master(address).broadcast_verify())
        assert wire.run(Master(address).read_typed(8236, INT)).value == 55
    assert wire.run(AX.read_typed(1009, INT)).value == 125


def test_a_broadcast_of_an_ax_v_goes_to_128() -> None:
    line = simulated(plant())
    body = b"\x03\x57\x04\xc8\x00"
    assert exchanged(line, Frame(128, 0, 0, 0x27, body)) == []
    assert Wire(line).run(AX.read_typed(1111, INT)).value == 200


def test_a_broadcast_that_is_out_of_range_is_received_and_not_applied(wire: Wire) -> None:
    wire.run(DRIVE.status_word())
    wire.run(DRIVE.broadcast_typed(0x6042, INT, 9000))
    assert wire.run(DRIVE.broadcast_verify())
    assert wire.run(DRIVE.read_standard(0x6042, 0, INT)).value == 0


def test_reset_leaves_faults_alone(wire: Wire) -> None:
    wire.run(DRIVE.write_typed(TRIP, WORD, 0x2310))
    wire.run(DRIVE.reset())
    assert wire.run(DRIVE.status_word()).fault


def test_the_profile_slink3_has_all_types_and_services() -> None:
    device = simulated_device("slink3", 7)
    wire = Wire(simulated([device]))
    assert wire.run(Master(7).read_typed(8236)).type_code == INT
    assert wire.run(Master(7).status_word()).state is State.SWITCH_ON_DISABLED
    assert isinstance(device, FlexMax)


@pytest.mark.parametrize(
    ("profile", "behind_it"), [("ax-v", "dgfc386"), ("flexmax", "ax-v"), ("dgfc386", "dgfc386")]
)
def test_what_is_behind_nothing(profile: str, behind_it: str) -> None:
    with pytest.raises(UsageError, match=f"{profile} has no {behind_it} behind it"):
        simulated_device(profile, 0, behind_it)


@pytest.mark.parametrize("address", [-1, 128, 255])
def test_addresses_that_no_slave_has(address: int) -> None:
    for profile in ("flexmax", "ax-v", "dgfc386", "slink3"):
        with pytest.raises(UsageError, match=r"a slave has 0\.\.127"):
            simulated_device(profile, address)


def test_a_model_that_is_not_known() -> None:
    with pytest.raises(UsageError, match="there is no profile 'flexmaxx' - did you mean 'flexmax'"):
        simulated_device("flexmaxx", 0)
