"""A drive for everything above: values in units, the write rule, views, limits, raw commands."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.device import Acts, Device, KeepsMemory, ReadsAll, Write
from multidrop.errors import (
    DeviceError,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    ProtocolError,
    UsageError,
)
from multidrop.points import Value
from multidrop.profile import Profile
from multidrop.protocols.ultra3000.device import Ultra3000Device, device
from multidrop.protocols.ultra3000.services import act
from multidrop.writing import Outcome, Written
from unit.protocols.ultra3000.wire import Wire

PROFILE = load_profile("ultra3000")
DRIVE = device(0, PROFILE, {})
BARE = Ultra3000Device(0, Profile("ultra3000", "ultra3000"))


def write(
    wire: Wire,
    point: str,
    value: Value,
    *,
    force: bool = False,
    verify: bool = True,
    drive: Ultra3000Device = DRIVE,
) -> Written:
    prepared = drive.prepare_write(point, value, force=force)
    written: Written = wire.run(drive.write(prepared, verify=verify))
    return written


def test_it_is_a_device_that_offers_everything() -> None:
    checked: Device = DRIVE
    assert isinstance(checked, ReadsAll)
    assert isinstance(checked, Acts)
    assert isinstance(checked, KeepsMemory)


# -- reading -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("point", "body", "digits", "value", "type_name"),
    [
        ("kp", "0110", "0200", 512, "uint16"),
        ("kp@max", "0119", "0FFF", 4095, "uint16"),
        ("preset_velocity.7@nv", "05B207", "FFFE7960", -100000, "int32"),
        ("drive_name", "0060", "41" + "00" * 63, "A", "string"),
        ("firmware", "0020", "0105", "1.05", "version"),
        ("analog_velocity_scale", "1180", "FFFFFF38", -200, "int32"),
        ("0x123", "1230", "00F0", "0x00F0", "hex"),
    ],
)
def test_a_read(point: str, body: str, digits: str, value: Value, type_name: str) -> None:
    wire = Wire({body: digits})
    sample = wire.run(DRIVE.read(DRIVE.point(point)))
    assert (sample.value, sample.type, sample.raw) == (value, type_name, digits.encode())
    assert sample.fault is None


def test_an_array_that_answers_with_index_and_value() -> None:
    wire = Wire({"05B007": "07000186A0"})
    sample = wire.run(DRIVE.read(DRIVE.point("0x05B.7")))
    assert (sample.value, sample.raw) == (100000, b"000186A0")


def test_a_value_of_another_width_breaks_the_protocol() -> None:
    with pytest.raises(ProtocolError, match="4 digits was expected, 8 came"):
        Wire({"0110": "00000200"}).run(DRIVE.read(DRIVE.point("kp")))


def test_a_value_of_another_width_is_asked_for_once_more() -> None:
    wire = Wire({"0110": ["00" * 34, "0200"]})
    assert wire.run(DRIVE.read(DRIVE.point("kp"))).raw == b"0200"
    assert wire.sent == ["0110"] * 2


def test_what_can_only_be_written_is_not_read() -> None:
    with pytest.raises(UsageError, match=r"host_control_mode .* can only be written"):
        DRIVE.read(DRIVE.point("host_control_mode"))


def test_an_array_without_an_element_is_all_of_its_points() -> None:
    assert [point.text for point in DRIVE.points("preset_current@nv")] == [
        f"0x05C.{element}@nv" for element in range(8)
    ]
    assert [point.text for point in DRIVE.points("kp")] == ["0x011"]
    assert [point.text for point in BARE.points("0x05C")] == ["0x05C"]


def test_all_readable_points() -> None:
    points = [str(point) for point in DRIVE.readable()]
    assert len(points) == len(set(points)) == 102 - 7 + 4 * 8 + 3 * 64
    assert "index_count (0x0B5.63)" in points
    assert "reset_faults (0x06F)" not in points
    assert BARE.readable() == []


# -- writing -----------------------------------------------------------------------------------


def test_a_write_in_units_is_confirmed() -> None:
    wire = Wire({"0110": ["0200", "0280"], "0111" + "0280": ""})
    record = write(wire, "kp", "5")
    assert record.outcome is Outcome.CONFIRMED
    assert record.asked == 5
    assert record.old is not None
    assert record.found is not None
    assert (record.old.raw, record.found.raw) == (b"0200", b"0280")
    assert wire.sent == ["0110", "01110280", "0110"]


@pytest.mark.parametrize(
    ("point", "value", "body"),
    [
        ("setpoint_velocity", -100000, "06D1FFFE7960"),
        ("setpoint_velocity", "0x186A0", "06D1000186A0"),
        ("setpoint_current", "1.5", "06C100C0"),
        ("override_mode", "preset_velocity", "043102"),
        ("override_mode", "Preset Velocity", "043102"),
        ("override_mode", "2", "043102"),
        ("drive_enable", "enable", "06B101"),
        ("baud_rate@nv", "9600", "050303"),
        ("preset_velocity.7@nv", 1, "05B30700000001"),
        ("drive_name", "A", "0061" + "41" + "00" * 63),
        ("analog_velocity_scale", -200, "1181FF38"),
        ("electrical_cycle_length", "0.3", "0E310003"),
        ("host_control_mode", 1, "061101"),
    ],
)
def test_what_is_sent(point: str, value: Value, body: str) -> None:
    wire = Wire({body: ""})
    wire.answers |= {body[:3] + "0": "!08", body[:3] + "2": "!08", "05B207": "!08"}
    record = write(wire, point, value, verify=False, force=point.startswith("electrical"))
    assert record.outcome is Outcome.UNVERIFIED
    assert wire.sent[-1] == body


@pytest.mark.parametrize(
    ("point", "value", "message"),
    [
        ("kp", "32", r"32 is out of range for kp: 0..31.9922"),
        ("override_mode", 10, "10 is out of range for override_mode: 0..9"),
        ("override_mode", "fast", "'fast' is not a whole number"),
        ("motor_poles", 3, "multiples of 2"),
        ("motor_gear_ratio.0", 0, "0 is no value"),
        ("drive_name", "x" * 65, "65 characters are too many: at most 64"),
        ("drive_name", 5, "5 is not text"),
        ("kp@default", 1, "only the working and the nv value can"),
        ("drive_status", 1, "drive_status .* is read-only in profile ultra3000; --force writes it"),
        ("baud_rate", "9600", "takes only non-volatile writes: 0x050@nv"),
        ("reset_faults", "1", "is an action and takes no value: reset_faults="),
        ("0x123", "10", "0x10, or 0xA if it is decimal"),
    ],
)
def test_a_write_that_is_refused_before_anything_is_sent(
    point: str, value: Value, message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        DRIVE.prepare_write(point, value)


def test_force_writes_past_limits_and_read_only_marks() -> None:
    wire = Wire({"0430": "00", "04310A": "", "0501": "!08", "0500": "05", "050103": "!08"})
    assert write(wire, "override_mode", 10, force=True, verify=False).outcome is Outcome.UNVERIFIED
    refused = write(wire, "baud_rate", "9600", force=True)
    assert isinstance(refused.error, DeviceError)
    with pytest.raises(UsageError, match="does not fit uint8"):
        DRIVE.prepare_write("override_mode", 256, force=True)


def test_text_is_compared_without_its_padding() -> None:
    blanks = "41" + "20" * 63
    wire = Wire({"0060": ["20" * 64, blanks], "0061" + "41" + "00" * 63: ""})
    record = write(wire, "drive_name", "A")
    assert record.outcome is Outcome.CONFIRMED
    assert record.found is not None
    assert record.found.raw == blanks.encode()


def test_a_read_back_in_another_width_and_one_that_differs() -> None:
    wire = Wire({"1180": ["00000064", "FFFFFF38"], "1181FF38": ""})
    assert write(wire, "analog_velocity_scale", -200).outcome is Outcome.CONFIRMED
    wire = Wire({"1180": ["00000064", "00000064"], "1181FF38": ""})
    record = write(wire, "analog_velocity_scale", -200)
    assert record.outcome is Outcome.DIFFERS
    assert isinstance(record.error, NotApplied)


def test_a_parameter_that_nobody_describes_is_written_in_the_width_of_its_answer() -> None:
    wire = Wire({"1230": ["0001", "0010"], "12310010": ""})
    assert write(wire, "0x123", "0x10").outcome is Outcome.CONFIRMED
    wire = Wire({"1230": ["0001", "0010"], "12310010": ""})
    assert write(wire, "0x123", 16, drive=BARE).outcome is Outcome.CONFIRMED
    wire = Wire({"1230": "!08", "12310010": ""})
    assert write(wire, "0x123", "0x0010").outcome is Outcome.UNVERIFIED
    with pytest.raises(UsageError, match="0x100 does not fit: the parameter has 2 digits"):
        write(Wire({"1230": "01"}), "0x123", "0x100")


def test_a_refusal_comes_with_the_drives_own_limits() -> None:
    wire = Wire({"0430": "00", "043109": "!05", "0438": "00", "0439": "08"})
    record = write(wire, "override_mode", 9)
    assert record.outcome is Outcome.NOT_APPLIED
    assert str(record.error) == (
        "refused with code 0005h: above the maximum; the drive allows 0..8"
    )
    wire = Wire({"06C0": "0000", "06C17FFF": "!05", "06C8": "FF40", "06C9": "00C0"})
    assert str(write(wire, "setpoint_current", 255.9921875).error).endswith("allows -1.5..1.5 A")
    wire = Wire({"1230": "0000", "12317FFF": "!05", "1238": "0001", "1239": "0002"})
    assert str(write(wire, "0x123", "0x7FFF").error).endswith("allows 0x0001..0x0002")
    wire = Wire({"05B007": "00000000", "05B10700000001": "!07", "05BA": "00", "05BB": "03"})
    assert str(write(wire, "preset_velocity.7", 1).error).endswith("the drive allows 0..3")


def test_a_refusal_whose_limits_the_drive_does_not_give() -> None:
    wire = Wire({"0430": "00", "043109": "!05", "0438": "00", "0439": None})
    assert str(write(wire, "override_mode", 9).error).endswith(": above the maximum")
    wire = Wire({"0430": "00", "043109": "!06"})
    assert str(write(wire, "override_mode", 9).error).endswith("while the drive is enabled")
    wire = Wire({"0060": "20" * 64, "0061" + "41" + "00" * 63: "!05"})
    assert str(write(wire, "drive_name", "A").error).endswith(": above the maximum")


# -- once --------------------------------------------------------------------------------------


def lost(point: str, body: str, value: Value, *read: str | None) -> tuple[Wire, Written]:
    """A write that nobody answers, and what the reads of its point give."""
    view = "2" if "@nv" in point else "0"
    wire = Wire({body: None, body[:3] + view: list(read)})
    return wire, write(wire, point, value)


def test_a_lost_write_of_a_setting_is_one_more_try() -> None:
    wire, record = lost("kp", "01110280", 5, "0200")
    assert record.outcome is Outcome.UNKNOWN
    assert wire.sent.count("01110280") == 2


@pytest.mark.parametrize(
    ("point", "body", "value"),
    [
        ("kp@nv", "01130280", 5),
        ("drive_enable", "06B101", 1),
        ("setpoint_velocity", "06D100000001", 1),
        ("0x123", "1231000A", "0x000A"),
        ("0x123@nv", "1233000A", "0x000A"),
    ],
)
def test_no_other_lost_write_is_repeated(point: str, body: str, value: Value) -> None:
    wire, record = lost(point, body, value, "00" * ((len(body) - 4) // 2))
    assert record.outcome is Outcome.UNKNOWN
    assert isinstance(record.error, OutcomeUnknown)
    assert wire.sent.count(body) == 1
    assert record.point.text == point.replace("kp", "0x011").replace(
        "drive_enable", "0x06B"
    ).replace("setpoint_velocity", "0x06D")
    assert record.point.name in (None, *PROFILE.points)


def test_a_lost_write_that_the_read_back_shows_is_confirmed() -> None:
    _, record = lost("kp@nv", "01130280", 5, "0200", "0280")
    assert record.outcome is Outcome.CONFIRMED
    assert record.point.role.value == "setting"


def test_nothing_is_written_when_the_old_value_cannot_be_read() -> None:
    wire = Wire({"0110": None})
    with pytest.raises(NoReply):
        write(wire, "kp", 5)
    assert wire.sent == ["0110"] * 3


# -- actions -----------------------------------------------------------------------------------


def test_an_action_is_written_without_a_value() -> None:
    wire = Wire({"0711": ""})
    record = write(wire, "define_home", "")
    assert (record.outcome, record.error) == (Outcome.UNVERIFIED, None)
    assert wire.sent == ["0711"]
    refused = write(Wire({"10A1": "!06"}), "reset_serial_port", "")
    assert refused.outcome is Outcome.NOT_APPLIED
    silent = write(Wire({"0711": None}), "define_home", "")
    assert silent.outcome is Outcome.UNKNOWN
    assert isinstance(silent.error, OutcomeUnknown)


def test_actions_by_name() -> None:
    assert set(DRIVE.actions) == {
        "define_home",
        "factory_reset",
        "reset_faults",
        "reset_serial_port",
        "start_homing",
    }
    assert BARE.actions == {}
    wire = Wire({"0CD1": ""})
    assert wire.run(DRIVE.prepare_action("start_homing")()).fields == {"action": "start_homing"}
    assert wire.sent == ["0CD1"]
    with pytest.raises(UsageError, match=r"kp .* is no action; actions are factory_reset, "):
        DRIVE.prepare_action("kp")
    with pytest.raises(UsageError, match="no action 'start_homin' - did you mean 'start_homing'"):
        DRIVE.prepare_action("start_homin")


def test_an_action_that_is_answered_wrongly_is_unknown() -> None:
    odd = Ultra3000Device(0, PROFILE)

    def breaks(parameter: int) -> Any:
        raise ProtocolError("it breaks")
        yield

    odd.master.act = breaks  # type: ignore[method-assign]
    with pytest.raises(OutcomeUnknown, match="home was sent and was not answered"):
        Wire().run(act(odd.master, 0x071, "home"))


# -- options -----------------------------------------------------------------------------------


def test_the_broadcast_address_is_an_option() -> None:
    assert device(1, PROFILE, {"broadcast": "128"}).master.broadcast == 128
    for text in ("256", "FFh", "-1"):
        with pytest.raises(UsageError, match=r"out of range: 0..255"):
            device(1, PROFILE, {"broadcast": text})


def test_a_write_has_its_record() -> None:
    prepared = DRIVE.prepare_write("kp", 5)
    assert prepared == Write(DRIVE.point("kp"), 5, False)


def test_the_broadcast_address_is_nobodys() -> None:
    with pytest.raises(UsageError, match="address 7 is the broadcast address of the line"):
        device(7, PROFILE, {"broadcast": "7"})
    assert device(8, PROFILE, {"broadcast": "7"}).address == 8
