"""An instrument for everything above: reading in groups, the map check, writes, services."""

from __future__ import annotations

import pytest
from datalink_wire import Instrument, response, steps_of

from multidrop.catalog import load_profile
from multidrop.conversation import Ask, Tell, Wait
from multidrop.device import Device
from multidrop.errors import NoReply, ProtocolError, UsageError
from multidrop.points import Role, Value
from multidrop.profile import PointDescription, Profile
from multidrop.protocols.datalink import Command, Frame
from multidrop.protocols.datalink.device import DatalinkDevice, device

PROFILE = Profile(
    "53test",
    "datalink",
    points={
        "limit": PointDescription("limit", "C103", Role.SETTING, minimum=0, maximum=200),
        "status": PointDescription("status", "L107", access="r"),
        "mode": PointDescription("mode", "B338", names={"0": "local", "7": "far away"}),
        "switch": PointDescription("switch", "L112", names={"0": "manual", "1": "automatic"}),
        "tenths": PointDescription("tenths", "B20", scale=0.1),
        "long": PointDescription("long", "mem/0x1000/33"),
    },
)


def new(profile: Profile = PROFILE, **options: str) -> DatalinkDevice:
    return device(3, profile, options)


def checked(profile: Profile = PROFILE) -> DatalinkDevice:
    """A device whose map was found."""
    found = new(profile)
    steps_of(found.read(found.point("B0")), response(0x8002, "06"), response(0x200, "00"))
    return found


def test_it_is_a_device() -> None:
    found: Device = new()
    assert found.address == 3
    assert found.profile is PROFILE


# -- reading ---------------------------------------------------------------------------------


def test_a_read_checks_the_map_once() -> None:
    one = new()
    steps, sample = steps_of(
        one.read(one.point("C103")), response(0x8002, "06"), response(0x735, "64 00 07")
    )
    assert steps[0] == Ask(Frame(Command.INTERROGATE, 3, 0x8002, 1), repeatable=True)
    assert (sample.value, sample.type, sample.raw) == (100.0, "real3", b"\x64\x00\x07")
    steps, _ = steps_of(one.read(one.point("limit")), response(0x735, "64 00 07"))
    assert len(steps) == 1


def test_another_map_is_a_clear_error_each_time() -> None:
    one = new()
    for _ in range(2):
        with pytest.raises(ProtocolError, match="8002h is 5, and map A has 6: this is no 53test"):
            steps_of(one.read(one.point("C103")), response(0x8002, "05"))


def test_an_unreadable_map_is_a_clear_error() -> None:
    one = new()
    with pytest.raises(NoReply, match="identifier at 8002h could not be read: no reply in 3"):
        steps_of(one.read(one.point("C103")), NoReply(3, (b"\1",)))


def test_memory_needs_no_map() -> None:
    one = new()
    steps, sample = steps_of(one.read(one.point("mem/0x1000/2")), response(0x1000, "01 02"))
    assert len(steps) == 1
    assert sample.value == b"\x01\x02"


def test_long_memory_comes_in_several_messages() -> None:
    one = new()
    steps, sample = steps_of(
        one.read(one.point("long")), response(0x1000, "01" * 32), response(0x1020, "02")
    )
    assert len(steps) == 2
    assert sample.raw == b"\1" * 32 + b"\2"


def test_map_b_has_nothing_to_check() -> None:
    one = new(load_profile("53sl6000"))
    steps, sample = steps_of(one.read(one.point("H0")), response(0x9CF, "64 00 00 00 07"))
    assert len(steps) == 1
    assert sample.value == 100.0


def test_a_hundred_points_are_ten_messages() -> None:
    one = checked()
    points = one.points("C100..C199")
    groups = one.plan(points)
    assert len(groups) == 10
    instrument = Instrument()
    values: list[Value] = []
    for number, point in enumerate(points):
        instrument.memory[point.memory_address : point.memory_address + 3] = (
            number.to_bytes(2, "big") + b"\x0f"
        )
    for group in groups:
        values += [sample.value for sample in instrument.run(one.read_group(group))]
    assert values == [float(number) for number in range(100)]
    assert len(instrument.messages) == 10


def test_a_group_keeps_its_order() -> None:
    one = checked()
    group = (one.point("L14"), one.point("B767"), one.point("L0"))
    steps, samples = steps_of(one.read_group(group), response(0x4FF, "11 01 40"))
    assert len(steps) == 1
    assert [sample.value for sample in samples] == [True, 0x11, True]


def test_a_range_is_not_one_point() -> None:
    with pytest.raises(UsageError, match=r"C103\.\.C105 names 3 points, where one is wanted"):
        new().point("C103..C105")
    assert new().point("C103..C103").text == "C103"


# -- preparing a write -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value", "message"),
    [
        ("C103", "200.5", r"200.5 is out of range for limit: 0\.\.200"),
        ("limit", "-1", "out of range for limit"),
        ("C104", "1e39", "does not fit a real of 3 bytes"),
        ("status", "1", r"status \(L107\) is read-only in profile 53test; --force writes it"),
        ("mode", "near", "'near' is not a whole number"),
        ("A8", "12345678901", "too long for type A"),
        ("long", "00" * 33, "one change takes at most 32 bytes"),
        ("mem/0x1000/2", "00", "1 bytes do not fit a point of 2"),
        ("C768", "1", "map A has C0..C767"),
        ("C103..C105", "1", "names 3 points"),
    ],
)
def test_what_is_refused_before_sending(text: str, value: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        new().prepare_write(text, value)


@pytest.mark.parametrize(
    ("text", "value", "command", "at", "data"),
    [
        ("C106", "150.5", Command.CHANGE, 0x73E, "4B 40 08"),
        ("C106", 150.5, Command.CHANGE, 0x73E, "4B 40 08"),
        ("H0", "-100", Command.CHANGE, 0xF00, "9C 00 00 00 07"),
        ("L14", "1", Command.CHANGE_BITS, 0x501, "BF 40"),
        ("L14", False, Command.CHANGE_BITS, 0x501, "BF 00"),
        ("switch", "Automatic", Command.CHANGE_BITS, 0x50E, "FE 01"),
        ("switch", "off", Command.CHANGE_BITS, 0x50E, "FE 00"),
        ("mode", "FAR_AWAY", Command.CHANGE, 0x352, "07"),
        ("mode", "0x10", Command.CHANGE, 0x352, "10"),
        ("tenths", "1.27", Command.CHANGE, 0x214, "0D"),
        ("A8", "TIC", Command.CHANGE, 0x1450, "54 49 43 00 00 00 00 00 00 00"),
        ("mem/0x1000/2", "08 0C", Command.CHANGE, 0x1000, "08 0C"),
        ("mem/0x1000/2", b"\x08\x0c", Command.CHANGE, 0x1000, "08 0C"),
    ],
)
def test_what_is_sent(text: str, value: Value, command: Command, at: int, data: str) -> None:
    instrument = Instrument()
    one = new()
    record = instrument.run(one.write(one.prepare_write(text, value)))
    assert record.outcome == "confirmed", record
    (change,) = [frame for frame in instrument.messages if frame.command != Command.INTERROGATE]
    assert change.command is command
    assert change.memory_address == at
    assert change.data == bytes.fromhex(data)


def test_force_goes_past_limits_and_marks() -> None:
    instrument = Instrument()
    one = new()
    for text, value in (("limit", "300"), ("status", "1")):
        record = instrument.run(one.write(one.prepare_write(text, value, force=True)))
        assert record.outcome == "confirmed"
    with pytest.raises(UsageError, match="does not fit"):
        one.prepare_write("limit", "1e39", force=True)


def test_what_was_asked_is_a_value_and_not_its_name() -> None:
    one, instrument = new(), Instrument()
    for text, value, asked in (("switch", "automatic", True), ("mode", "far away", 7)):
        record = instrument.run(one.write(one.prepare_write(text, value)))
        assert record.asked == record.found.value == asked
        assert type(record.asked) is type(asked)


def test_a_write_checks_the_map_too() -> None:
    one = new()
    write = one.prepare_write("C103", "100")
    with pytest.raises(ProtocolError, match="8002h is 0"):
        steps_of(one.write(write), response(0x8002, "00"))


# -- services --------------------------------------------------------------------------------


def test_what_the_protocol_does_not_have() -> None:
    one = new()
    with pytest.raises(UsageError, match="no command that clears faults"):
        one.clear_faults()
    with pytest.raises(UsageError, match="no command that resets an instrument's serial"):
        one.reset_comm()


def test_raw_interrogate() -> None:
    steps, report = steps_of(new().prepare_raw("E0 02 00 10")(), response(0x1000, "08 0C"))
    assert steps == [Ask(Frame(Command.INTERROGATE, 3, 0x1000, 2))]
    assert report.fields == {
        "command": "interrogate",
        "memory_address": 0x1000,
        "count": 2,
        "data": "080c",
    }
    assert report.lines == ("3 response 1000h = 08 0C",)


def test_raw_change_is_echoed_and_never_acknowledged() -> None:
    steps, report = steps_of(new().prepare_raw("A3 02 00 10 08 0C")(), response(0x1000, "08 0C"))
    assert steps == [Ask(Frame(Command.CHANGE, 3, 0x1000, 2, b"\x08\x0c"))]
    assert report.lines[1] == "this is the echo; it was not acknowledged, so nothing was changed"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("xx", "'xx' is not hex bytes: CMD, NUM, LO ADD, HI ADD, data"),
        ("", "'' is too short: CMD, NUM, LO ADD, HI ADD at least"),
        ("E0 01 00", "is too short"),
        ("E0 21 00 10", "33 bytes are too many for a message"),
        ("E0 02 00 10 55", "NUM 2 does not fit 1 bytes of data"),
        ("A0 02 00 10 55", "NUM 2 does not fit 1 bytes of data"),
        ("E4 02 00 10", "'E4 02 00 10' is for address 4, not 3"),
        ("40 02 00 10", "64 is no Datalink command"),
        ("80", "a host sends no Response, and an Acknowledge belongs to its write"),
        ("23 01 00 10 55", "a host sends no Response"),
    ],
)
def test_raw_that_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        new().prepare_raw(text)


# -- options ---------------------------------------------------------------------------------


def test_options() -> None:
    assert new().settle == 1.0
    assert new(settle="0.25").settle == 0.25
    steps, _ = steps_of(new(stuffing="off").read(new().point("mem/0x7E/1")), response(0x7E, "00"))
    assert isinstance(steps[0], Ask)
    assert steps[0].frame.encode() == bytes.fromhex("7E E3 01 7E 00 62")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"settle": "soon"}, "settle='soon' is not a number of seconds"),
        ({"settle": "-1"}, "settle=-1 s is out of range"),
        ({"settle": "nan"}, "settle=nan s is out of range"),
        ({"settle": "61"}, "settle=61 s is out of range"),
        ({"stuffing": "no"}, "stuffing='no' is none of on, off"),
    ],
)
def test_options_out_of_range(options: dict[str, str], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        device(3, PROFILE, options)


def test_dialects_and_bases() -> None:
    with pytest.raises(UsageError, match="dialect 'map-c' is none of map-a, map-b"):
        new(Profile("x", "datalink", dialect="map-c"))
    known = new(Profile("x", "datalink", dialect="map-b", bases={"C": 0x4000}))
    assert known.point("C1").memory_address == 0x4003
    with pytest.raises(UsageError, match="in no source"):
        known.point("B1")
    with pytest.raises(UsageError, match="address 32 is out of range"):
        device(32, PROFILE, {})


@pytest.mark.parametrize("profile", ["53mc5000", "53sl6000"])
def test_the_entry_sequence_is_told_and_a_byte_shows_that_the_port_is_open(profile: str) -> None:
    one = device(3, load_profile(profile), {})
    assert list(one.actions) == ["open_configuration_port"]
    at = 0x200 if profile == "53mc5000" else 0x9CF
    steps, report = steps_of(one.prepare_action("open_configuration_port")(), response(at, "00"))
    told, waited, asked = steps
    assert isinstance(told, Tell)
    assert told.frame.encode() == bytes.fromhex("03 1B 0E 15")
    assert told.within is None
    assert isinstance(waited, Wait)
    assert isinstance(asked, Ask)
    assert asked.frame == Frame(Command.INTERROGATE, 3, at, 1)
    assert report.fields == {"action": "open_configuration_port"}


def test_a_port_that_does_not_open() -> None:
    with pytest.raises(NoReply, match="the configuration port did not open: no reply in 3"):
        steps_of(new().prepare_action("open_configuration_port")(), NoReply(3))


def test_another_action() -> None:
    with pytest.raises(UsageError, match="'open' is no action; the only one is open_configuration"):
        new().prepare_action("open")
