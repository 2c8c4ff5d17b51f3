"""Status, faults, serial port, raw commands, saved values, broadcast, and the protocol itself."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.device import ProtocolModule, Received
from multidrop.errors import (
    DeviceError,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    ProtocolError,
    UsageError,
)
from multidrop.profile import Profile
from multidrop.protocols import PROTOCOLS, ultra3000
from multidrop.protocols.ultra3000.device import Ultra3000Device
from multidrop.writing import Outcome, Written
from unit.protocols.ultra3000.wire import PRODUCT, Wire

PROFILE = load_profile("ultra3000")
DRIVE = Ultra3000Device(0, PROFILE)
STATUS = {"0020": "0105", "0730": "00008180", "0740": "00000000", "0750": "00"}


@pytest.mark.parametrize(("word", "said"), [("00008180", "enabled"), ("00008100", None)])
def test_whether_a_drive_is_enabled(word: str, said: str | None) -> None:
    assert Wire({"0730": word}).run(DRIVE.running()) == said


# -- status ------------------------------------------------------------------------------------


def test_status_of_an_enabled_drive() -> None:
    report = Wire(STATUS).run(DRIVE.status())
    assert report.fields == {
        "fault": False,
        "status_word": 0x8180,
        "state": "enabled",
        "malfunction_code": 0,
        "enabled": True,
        "bits": ["enabled", "bus charged", "ready"],
        "faults": [],
        "product_type": "22 kW 460 V, indexing",
        "firmware": "1.05",
    }
    assert "faults             none" in report.lines


def test_status_of_a_drive_in_fault() -> None:
    report = Wire({**STATUS, "0730": "00000200", "0740": "00040000", "0750": "13"}).run(
        DRIVE.status()
    )
    assert report.fields["fault"] is True
    assert report.fields["malfunction_code"] == 19
    assert report.fields["state"] == "E19 following error"
    assert report.fields["enabled"] is False
    assert "drive              disabled" in report.lines
    assert "faults             following error" in report.lines


def test_status_shows_a_fault_that_only_the_run_status_tells() -> None:
    report = Wire({**STATUS, "0750": "22"}).run(DRIVE.status())
    assert report.fields["fault"] is True
    assert report.fields["state"] == "E34 ground fault"


# -- faults and serial port --------------------------------------------------------------------


@pytest.mark.parametrize(("run", "state"), [("FF", "disabled, not faulted"), ("00", "enabled")])
def test_faults_that_are_cleared(run: str, state: str) -> None:
    wire = Wire({"06F1": "", "0740": "00000000", "0750": run})
    report = wire.run(DRIVE.clear_faults())
    assert report.fields == {"cleared": True, "state": state}
    assert wire.sent == ["06F1", "0740", "0750"]


@pytest.mark.parametrize(
    ("faults", "run", "still"),
    [
        ("00040008", "13", "motor thermostat, following error"),
        ("00000000", "22", "E34 ground fault"),
    ],
)
def test_a_fault_that_is_still_there_is_named(faults: str, run: str, still: str) -> None:
    wire = Wire({"06F1": "", "0740": faults, "0750": run})
    with pytest.raises(NotApplied, match=f"still there: {still}") as caught:
        wire.run(DRIVE.clear_faults())
    assert caught.value.found == still


@pytest.mark.parametrize("answers", [{"0740": None}, {"0740": "00"}, {"0740": "!08"}])
def test_faults_that_cannot_be_read_after_the_reset(answers: dict[str, str | None]) -> None:
    with pytest.raises(OutcomeUnknown, match="whether one is still there cannot be read"):
        Wire({"06F1": "", **answers}).run(DRIVE.clear_faults())


def test_a_reset_that_is_refused() -> None:
    with pytest.raises(DeviceError, match="not while the drive is enabled"):
        Wire({"10A1": "!06"}).run(DRIVE.reset_comm())


def test_the_serial_port_is_reset() -> None:
    wire = Wire({"10A1": ""})
    assert wire.run(DRIVE.reset_comm()).fields == {"reset": True}
    assert wire.sent == ["10A1"]


# -- raw ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "body", "answer", "fields"),
    [
        (
            "073 0",
            "0730",
            "00008180",
            {"command": "read working", "response": 0, "text": "OK", "data": "00008180"},
        ),
        (
            "06d1 000186a0",
            "06D1000186A0",
            "",
            {"command": "write working", "response": 0, "text": "OK", "data": ""},
        ),
        (
            "043105",
            "043105",
            "!05",
            {"command": "write working", "response": 5, "text": "above the maximum", "data": ""},
        ),
    ],
)
def test_raw(text: str, body: str, answer: str, fields: dict[str, Any]) -> None:
    wire = Wire({body: answer})
    report = wire.run(DRIVE.prepare_raw(text)())
    assert report.fields == {**fields, "parameter": f"0x{body[:3]}"}
    assert wire.sent == [body]


@pytest.mark.parametrize("text", ["", "073", "8000", "0730x"])
def test_raw_that_is_no_command(text: str) -> None:
    with pytest.raises(UsageError, match=r"is not a command: parameter \(000 to 7FF\)"):
        DRIVE.prepare_raw(text)


def test_raw_is_sent_once_and_a_lost_read_is_no_reply() -> None:
    wire = Wire()
    with pytest.raises(NoReply):
        wire.run(DRIVE.prepare_raw("0730")())
    with pytest.raises(OutcomeUnknown, match="write working 06F was sent and was not answered"):
        wire.run(DRIVE.prepare_raw("06F1")())
    assert wire.sent == ["0730", "06F1"]


# -- saved values ------------------------------------------------------------------------------


def copied(wire: Wire, text: str, *, save: bool, verify: bool = True) -> list[Written]:
    records: list[Written] = wire.run(
        DRIVE.copy(DRIVE.prepare_copy(text, save=save), verify=verify)
    )
    return records


def test_save() -> None:
    wire = Wire({"0110": "0280", "0112": ["0200", "0280"], "0115": ""})
    (record,) = copied(wire, "kp", save=True)
    assert record.outcome is Outcome.CONFIRMED
    assert (record.point.text, record.asked) == ("0x011@nv", 5)
    assert record.old is not None
    assert record.old.raw == b"0200"
    assert wire.sent == ["0110", "0112", "0115", "0112"]


def test_load() -> None:
    wire = Wire({"0110": ["0280", "0200"], "0112": "0200", "0114": ""})
    (record,) = copied(wire, "0x011", save=False)
    assert (record.outcome, record.asked, record.point.text) == (Outcome.CONFIRMED, 4, "0x011")


def test_an_array_is_saved_as_a_whole() -> None:
    answers: dict[str, Any] = {f"05C00{n}": "00C0" for n in range(8)}
    answers |= {f"05C20{n}": ["0040", "00C0"] for n in range(8)}
    answers["05C203"] = "0040"
    wire = Wire({**answers, "05C5": ""})
    records = copied(wire, "preset_current", save=True)
    assert [record.outcome is Outcome.CONFIRMED for record in records] == [
        element != 3 for element in range(8)
    ]
    assert wire.sent.count("05C5") == 1
    assert isinstance(records[3].error, NotApplied)
    assert str(records[3].error) == (
        "preset_current (0x05C.3@nv): 1.5 was copied, 0.5 is read back"
    )


def test_a_copy_that_is_refused_and_one_that_is_not_verified() -> None:
    wire = Wire({"0110": "0280", "0112": "0200", "0115": "!03"})
    (record,) = copied(wire, "kp", save=True)
    assert record.outcome is Outcome.NOT_APPLIED
    wire = Wire({"0110": "0280", "0112": "0200", "0115": ""})
    (record,) = copied(wire, "kp", save=True, verify=False)
    assert record.outcome is Outcome.UNVERIFIED


@pytest.mark.parametrize(
    ("after", "outcome", "verify"),
    [
        ("0280", Outcome.CONFIRMED, True),
        ("0200", Outcome.UNKNOWN, True),
        (None, Outcome.UNKNOWN, True),
        ("0280", Outcome.UNKNOWN, False),
    ],
)
def test_a_copy_that_nobody_answers_is_sent_once(
    after: str | None, outcome: Outcome, verify: bool
) -> None:
    wire = Wire({"0110": "0280", "0112": ["0200", after], "0115": None})
    (record,) = copied(wire, "kp", save=True, verify=verify)
    assert record.outcome is outcome
    assert wire.sent.count("0115") == 1
    if outcome is Outcome.UNKNOWN:
        assert isinstance(record.error, OutcomeUnknown)


def test_a_copy_whose_read_back_fails() -> None:
    wire = Wire({"0110": "0280", "0112": ["0200", "!08"], "0115": ""})
    (record,) = copied(wire, "kp", save=True)
    assert record.outcome is Outcome.UNVERIFIED
    assert isinstance(record.error, DeviceError)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("preset_velocity.7", "an array is saved as a whole: preset_velocity"),
        ("0x123.7", "an array is saved as a whole: 0x123"),
        ("kp@nv", "kp@nv: a point is saved without @nv"),
        ("setpoint_velocity", "setpoint_velocity .* cannot be saved; --force asks the drive"),
    ],
)
def test_a_copy_that_cannot_be_said(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        DRIVE.prepare_copy(text, save=True)


def test_force_asks_the_drive() -> None:
    assert DRIVE.prepare_copy("setpoint_velocity", save=False, force=True).points


def test_what_differs() -> None:
    points = {str(point): point for point in DRIVE.comparable()}
    assert len(points) == sum("2" in item.functions for item in PROFILE.points.values()) + 217
    wire = Wire({"0110": "0280", "0112": "0200", "0116": "0200"})
    memory = wire.run(DRIVE.compare(points["kp (0x011)"]))
    assert (memory.unsaved, memory.customised) == (True, False)
    wire = Wire({"0110": "0280", "0112": "0280", "0116": "0200"})
    memory = wire.run(DRIVE.compare(points["kp (0x011)"]))
    assert (memory.unsaved, memory.customised) == (False, True)


def test_what_a_drive_or_a_profile_does_not_have_differs_from_nothing() -> None:
    memory = Wire({"0110": "0280", "0112": "!08", "0116": "0200"}).run(
        DRIVE.compare(DRIVE.point("kp"))
    )
    assert memory.saved is None
    assert not memory.unsaved
    assert not memory.customised
    memory = Wire({"06D0": "00000001"}).run(DRIVE.compare(DRIVE.point("setpoint_velocity")))
    assert (memory.saved, memory.default) == (None, None)


# -- broadcast ---------------------------------------------------------------------------------


def broadcast(
    wire: Wire, *points: tuple[str, str], addresses: tuple[int, ...] = (0,), **how: bool
) -> list[Received]:
    prepared = PROTOCOLS["ultra3000"].prepare_broadcast(PROFILE, points, addresses, {}, **how)
    received: list[Received] = wire.run(prepared())
    return received


def test_a_broadcast_is_told_and_read_back() -> None:
    wire = Wire({"0110": ["0200", "0280"], "05B207": ["00000000", "00000001"]})
    (found,) = broadcast(wire, ("kp", "5"), ("preset_velocity.7@nv", "1"))
    assert wire.told == ["FF0111" + "0280", "FF05B3" + "07" + "00000001"]
    assert (found.address, found.received, found.applied, found.note) == (0, None, True, "")
    assert [record.outcome for record in found.written] == [Outcome.CONFIRMED] * 2


def test_a_broadcast_that_one_drive_did_not_take() -> None:
    (found,) = broadcast(Wire({"0110": "0240"}), ("kp", "5.5"))
    assert found.applied is False
    assert str(found.written[0].error) == (
        "drive 0, kp (0x011): 5.5 was broadcast, 4.5 is read back"
    )


def test_nothing_is_broadcast_to_a_silent_drive_unless_one_keeps_going() -> None:
    wire = Wire({"0110": None})
    with pytest.raises(NoReply, match="drive 0 did not answer, so nothing was broadcast"):
        broadcast(wire, ("kp", "5"))
    assert wire.told == []
    (found,) = broadcast(wire, ("kp", "5"), keep_going=True)
    assert wire.told == ["FF01110280"]
    assert (found.applied, found.note) == (None, "it was silent before the broadcast")


def test_a_point_that_cannot_be_read_is_broadcast_all_the_same() -> None:
    (found,) = broadcast(Wire({"0610": "!08"}), ("host_control_mode", "1"), force=True)
    assert found.applied is None
    assert found.written[0].outcome is Outcome.UNKNOWN


def test_a_broadcast_action_is_not_verified() -> None:
    wire = Wire()
    (found,) = broadcast(wire, ("reset_faults", ""), force=True)
    assert wire.told == ["FF06F1"]
    assert found.applied is None
    assert found.written[0].outcome is Outcome.UNVERIFIED


@pytest.mark.parametrize(
    ("point", "value", "message"),
    [
        ("drive_enable", "0", "has role command: every drive would act on it; --force"),
        ("drive_address@nv", "1", "has role communication"),
        ("kp", "99", "out of range for kp"),
    ],
)
def test_a_broadcast_that_is_refused(point: str, value: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        broadcast(Wire(), (point, value))


def test_a_broadcast_of_what_nobody_describes_needs_its_digits() -> None:
    bare = Profile("ultra3000", "ultra3000")
    protocol = PROTOCOLS["ultra3000"]
    wire = Wire({"1230": ["0000", "0001"]})
    (found,) = wire.run(protocol.prepare_broadcast(bare, [("0x123", "0x0001")], [0], {})())
    assert found.applied is True
    with pytest.raises(UsageError, match="needs all its digits to be broadcast"):
        protocol.prepare_broadcast(bare, [("0x123", 1)], [0], {})  # type: ignore[list-item]


# -- the protocol ------------------------------------------------------------------------------


def test_the_protocol_as_everything_above_knows_it() -> None:
    protocol: ProtocolModule = PROTOCOLS["ultra3000"]
    assert protocol.name == "ultra3000"
    assert protocol.line is ultra3000.LINE
    assert set(protocol.options) == {"broadcast"}
    frame = ultra3000.Frame(0, 0x073)
    assert protocol.describe(frame) == "0 073 read working"
    assert protocol.from_master(frame)
    assert protocol.decoder().receive_data(frame.encode())[0].frame == frame  # type: ignore[union-attr]
    assert isinstance(protocol.device(1, PROFILE, {}), Ultra3000Device)


@pytest.mark.parametrize(("network", "answer"), [(False, 0.2), (True, 0.5)])
def test_times(network: bool, answer: float) -> None:
    timing = ultra3000.LINE.timing(network=network)
    assert (timing.answer, timing.silence, timing.gap) == (answer, 1.0, 0.0)
    assert timing.character == 10 / 38400
    assert str(ultra3000.LINE.format) == "8N1"


def test_the_product_type_is_what_shows_the_echo() -> None:
    wire = Wire(PRODUCT)
    with pytest.raises(ProtocolError):
        wire.run(DRIVE.master.read_number(0, 4))
