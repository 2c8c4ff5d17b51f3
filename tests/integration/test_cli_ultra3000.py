"""The command line with Ultra3000 drives, in processes of its own."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from integration.processes import Address, Ran, Simulator, multidrop, running, simulator
from integration.threads import served
from integration.writes import logged
from multidrop.catalog import load_profile
from multidrop.protocols import ultra3000
from multidrop.sim.faults import NoFaults
from multidrop.sim.line import LineFaults, SimulatedLine
from multidrop.sim.ultra3000 import SimulatedUltra3000

PROFILE = load_profile("ultra3000")
HOME = "0 071 write working"  # define_home, as a trace shows it
MOTOR_THERMOSTAT, ILLEGAL_HALL_STATE = 1 << 3, 1 << 10
READING = ["v", "device", "point", "name", "value", "unit", "type", "raw", "fault", "time", "ms"]


@pytest.fixture(scope="module")
def axes() -> Iterator[Simulator]:
    """ultra3000:0 and ultra3000:1 over TCP, for tests that leave no trace."""
    with simulator("ultra3000:0", "ultra3000:1") as started:
        yield started


@pytest.fixture
def drive() -> SimulatedUltra3000:
    """A drive of this test alone, at address 0."""
    return SimulatedUltra3000(0, PROFILE)


@pytest.fixture
def line(drive: SimulatedUltra3000) -> Iterator[Address]:
    """Where it is to be found."""
    with served(a_line(drive)) as address:
        yield address


def a_line(*drives: SimulatedUltra3000, echo: bool = False) -> SimulatedLine:
    return SimulatedLine(
        drives,
        ultra3000.decoder,
        character=ultra3000.LINE.character,
        faults=LineFaults(NoFaults(), echo=echo),
    )


def sent(ran: Ran) -> list[str]:
    """What the master sent, as a trace describes it."""
    return re.findall(r" > :[0-9A-F]+\\r  \| (.*)", ran.err)


# -- reading -----------------------------------------------------------------------------------


def test_every_point_of_the_profile(axes: Simulator) -> None:
    ran = multidrop("read", axes.device("ultra3000:0"), "--all", "--json")
    assert (ran.status, ran.err) == (0, "")
    readable = [point for point in PROFILE.points.values() if "0" in point.functions]
    assert {line["name"] for line in ran.objects} == {point.name for point in readable}
    assert len(ran.objects) == sum(point.elements or 1 for point in readable)
    for reading in ran.objects:
        assert list(reading) == READING
        assert re.fullmatch(r"[0-9A-F]{2,128}", reading["raw"])
        assert reading["fault"] is None


def test_views_and_units(axes: Simulator) -> None:
    device = axes.device("ultra3000:0")
    views = ["kp", "kp@nv", "kp@default", "kp@min", "kp@max", "0x05C.3", "firmware"]
    ran = multidrop("read", device, *views, "--json")
    assert [[line[key] for key in READING[2:8]] for line in ran.objects] == [
        ["0x011", "kp", 4.0, None, "uint16", "0200"],
        ["0x011@nv", "kp", 4.0, None, "uint16", "0200"],
        ["0x011@default", "kp", 4.0, None, "uint16", "0200"],
        ["0x011@min", "kp", 0.0, None, "uint16", "0000"],
        ["0x011@max", "kp", 31.9921875, None, "uint16", "0FFF"],
        ["0x05C.3", "preset_current", 0.0, "A", "int16", "0000"],
        ["0x002", "firmware", "1.16", None, "version", "0110"],
    ]


def test_a_reading_for_a_person(axes: Simulator) -> None:
    ran = multidrop("read", axes.device("ultra3000:0"), "bus_voltage", "run_status", "--trace")
    voltage, status = ran.out.splitlines()
    assert re.fullmatch(r"bus_voltage \(0x08B\) +325 V +uint16 +0145 +\d+\.\d ms", voltage)
    assert "disabled" in status
    assert sent(ran) == ["0 08B read working", "0 075 read working"]


def test_a_refused_read_and_a_bare_number(axes: Simulator) -> None:
    ran = multidrop("read", axes.device("ultra3000:0"), "0x7F0", "kp", "--json")
    assert ran.status == 3
    refused, read = ran.objects
    assert refused["error"]["code"] == 8
    assert refused["error"]["kind"] == "refused"
    assert read["value"] == 4.0
    ran = multidrop("read", axes.device("ultra3000:0"), "11")
    assert ran.status == 2
    assert "0x011 if 11 is hex" in ran.err
    assert "0x00B if it is decimal" in ran.err


def test_watch_without_a_terminal(drive: SimulatedUltra3000, line: Address) -> None:
    device = line.device("ultra3000:0")
    with running("watch", device, "kp", "drive_name", "--every", "0.02") as watching:
        assert watching.wait_for("kp").endswith(" 4")
        assert multidrop("write", device, "kp=5").status == 0
        assert watching.wait_for("kp").endswith(" 5")
        assert watching.interrupt().status == 130


# -- writing -----------------------------------------------------------------------------------


def test_a_write_as_json(drive: SimulatedUltra3000, line: Address, audit: Path) -> None:
    device = line.device("ultra3000:0")
    ran = multidrop("write", device, "kp=5.5", "--json", "--trace")
    found = ran.object
    found.pop("time")
    assert found == {
        "v": 1,
        "device": device,
        "point": "0x011",
        "name": "kp",
        "old": 4.0,
        "asked": 5.5,
        "found": 5.5,
        "raw": "02C0",
        "outcome": "confirmed",
    }
    assert sent(ran) == [
        "0 000 read working",
        "0 011 read working",
        "0 011 write working := 02C0",
        "0 011 read working",
    ]
    assert (drive.parameters[0x011].working, drive.parameters[0x011].saved) == (["02C0"], ["0200"])
    assert [entry["outcome"] for entry in logged(audit)] == ["confirmed"]


def test_a_non_volatile_write(drive: SimulatedUltra3000, line: Address) -> None:
    ran = multidrop("write", line.device("ultra3000:0"), "kp=6", "--nv", "--trace")
    assert ran.status == 0
    assert "0 011 write non volatile := 0300" in sent(ran)
    assert (drive.parameters[0x011].working, drive.parameters[0x011].saved) == (["0300"], ["0300"])


def test_limits(drive: SimulatedUltra3000, line: Address) -> None:
    """Refused before a byte is sent; with --force by the drive, whose own limits are shown."""
    device = line.device("ultra3000:0")
    ran = multidrop("write", device, "kp=99", "--trace")
    assert (ran.status, sent(ran)) == (2, [])
    assert "out of range for kp: 0..31.99" in ran.err
    ran = multidrop("write", device, "kp=99", "--force", "--json")
    assert (ran.status, ran.object["outcome"]) == (3, "not-applied")
    assert ran.object["error"] == {
        "kind": "refused",
        "code": 5,
        "text": "above the maximum; the drive allows 0..31.99219",
    }
    assert drive.parameters[0x011].working == ["0200"]


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("kpp=1", "did you mean 'kp'"),
        ("preset_current=1", "name an element"),
        ("preset_current.9=1", "elements 0..7"),
        ("drive_status=1", "read-only"),
        ("kp@max=1", "cannot be written"),
        ("drive_enable=1", "--yes says so"),
        ("define_home=", "--yes says so"),
    ],
)
def test_what_is_refused_before_a_port_is_opened(assignment: str, message: str) -> None:
    ran = multidrop("write", "ultra3000:0@tcp://127.0.0.1:1", assignment)
    assert (ran.status, ran.out) == (2, "")
    assert message in ran.err


def test_not_while_the_drive_is_enabled(drive: SimulatedUltra3000, line: Address) -> None:
    device = line.device("ultra3000:0")
    ran = multidrop("write", device, "drive_enable=1", "setpoint_velocity=2000", "--yes")
    assert ran.status == 0
    assert drive.servo.enabled
    ran = multidrop("reset-comm", device)
    assert ran.status == 3
    assert "not while the drive is enabled" in ran.err


# -- working and saved values ------------------------------------------------------------------


def test_compare_save_and_load(drive: SimulatedUltra3000, line: Address) -> None:
    device = line.device("ultra3000:0")
    drive.parameters[0x011].working = ["0280"]
    drive.parameters[0x012].working = drive.parameters[0x012].saved = ["0040"]
    ran = multidrop("compare-memory", device)
    assert ran.status == 0
    assert re.search(r"kp \(0x011\) +5 +4 +4 +changed, not saved", ran.out)
    assert re.search(r"ki \(0x012\) +0.5 +0.5 +0 +saved, not the default", ran.out)
    ran = multidrop("save", device, "kp", "--json")
    assert ran.status == 0
    found = ran.object
    assert (found["point"], found["old"], found["found"]) == ("0x011@nv", 4.0, 5.0)
    assert found["raw"] == "0280"
    assert drive.parameters[0x011].saved == ["0280"]
    drive.parameters[0x011].working = ["0FFF"]
    assert multidrop("load", device, "kp").status == 0
    assert drive.parameters[0x011].working == ["0280"]
    rows = multidrop("compare-memory", device, "--json").objects
    assert [(row["name"], row["unsaved"], row["customised"]) for row in rows] == [
        ("kp", False, True),
        ("ki", False, True),
    ]


def test_what_cannot_be_saved() -> None:
    ran = multidrop("save", "ultra3000:0@tcp://127.0.0.1:1", "kp", "firmware")
    assert ran.status == 2
    assert "firmware (0x002) cannot be saved" in ran.err


# -- services ----------------------------------------------------------------------------------


def test_a_fault_that_goes(drive: SimulatedUltra3000, line: Address) -> None:
    device = line.device("ultra3000:0")
    drive.servo.faults = MOTOR_THERMOSTAT
    found = multidrop("status", device, "--json").object
    assert (found["fault"], found["state"]) == (True, "E04 motor thermostat")
    assert (found["faults"], found["malfunction_code"]) == (["motor thermostat"], 4)
    ran = multidrop("clear-faults", device)
    assert ran.status == 0
    assert "no fault is left: disabled, not faulted" in ran.out


def test_a_fault_whose_cause_is_still_there(
    drive: SimulatedUltra3000, line: Address, audit: Path
) -> None:
    drive.servo.faults = MOTOR_THERMOSTAT | ILLEGAL_HALL_STATE
    drive.servo.cause = ILLEGAL_HALL_STATE
    ran = multidrop("clear-faults", line.device("ultra3000:0"))
    assert ran.status == 8
    assert "still there: illegal Hall state" in ran.err
    assert "motor thermostat" not in ran.err
    assert [entry["outcome"] for entry in logged(audit)] == ["not-applied"]


def test_an_action_needs_yes_and_a_name(drive: SimulatedUltra3000, line: Address) -> None:
    device = line.device("ultra3000:0")
    ran = multidrop("action", device)
    assert ran.status == 0
    assert [row.split()[0] for row in ran.out.splitlines()] == [
        "factory_reset",
        "reset_faults",
        "define_home",
        "start_homing",
        "reset_serial_port",
    ]
    ran = multidrop("action", device, "define_home", "--trace")
    assert (ran.status, sent(ran)) == (2, [])
    assert "--yes says so" in ran.err
    ran = multidrop("action", device, "define_hom", "--yes")
    assert ran.status == 2
    assert "did you mean 'define_home'" in ran.err
    ran = multidrop("action", device, "define_home", "--yes", "--trace")
    assert ran.status == 0
    assert sent(ran) == ["0 000 read working", HOME]


def test_raw(axes: Simulator) -> None:
    device = axes.device("ultra3000:0")
    found = multidrop("raw", device, "0750", "--json").object
    assert (found["command"], found["parameter"]) == ("read working", "0x075")
    assert (found["response"], found["data"]) == (0, "FF")
    ran = multidrop("raw", device, "0111")
    assert "write working 011: invalid data" in ran.out
    assert ran.status == 3
    assert (
        multidrop("save", "ultra3000:9@" + axes.port, "kp", "--json", "--timeout", "0.05").object[
            "error"
        ]["kind"]
        == "no-reply"
    )
    assert multidrop("raw", device, "8000").status == 2


def test_a_broadcast() -> None:
    drives = [SimulatedUltra3000(address, PROFILE) for address in (0, 1)]
    with served(a_line(*drives)) as line:
        broadcast = f"ultra3000@{line.port}"
        ran = multidrop("broadcast", broadcast, "kp=7", "--verify", "0,1", "--json", "--trace")
        assert ran.status == 0
        assert [(row["old"], row["found"], row["applied"]) for row in ran.objects] == [
            (4.0, 7.0, True)
        ] * 2
        assert "255 011 write working := 0380" in sent(ran)
        ran = multidrop("broadcast", broadcast, "kp=8", "--verify", "0,2", "--timeout", "0.05")
        assert ran.status == 4
        assert "nothing was broadcast" in ran.err
    assert [drive.parameters[0x011].working for drive in drives] == [["0380"]] * 2


# -- a line that hears itself ------------------------------------------------------------------


@pytest.mark.parametrize("echo", ["auto", "on"])
def test_an_action_with_echo_and_a_drive(drive: SimulatedUltra3000, echo: str) -> None:
    with served(a_line(drive, echo=True)) as line:
        device = line.device("ultra3000:0", echo=echo)
        ran = multidrop("action", device, "define_home", "--yes", "--trace")
    assert (ran.status, ran.err.count(HOME)) == (0, 3)  # sent, its echo, and the answer


@pytest.mark.parametrize(
    ("echo", "status", "actions"), [("auto", 4, 0), ("on", 7, 1), ("off", 4, 0)]
)
def test_an_action_with_echo_and_no_drive_is_never_done(
    echo: str, status: int, actions: int
) -> None:
    with served(a_line(echo=True)) as line:
        device = line.device("ultra3000:0", echo=echo, timeout=0.05)
        ran = multidrop("action", device, "define_home", "--yes", "--trace")
    assert ran.status == status
    assert sent(ran).count(HOME) == actions
    if not actions:
        assert "nothing was sent but the read of 000" in ran.err


def test_simulate_with_echo() -> None:
    """A simulated line that hears itself: a drive answers its action, nobody at address 9 does."""
    with simulator("ultra3000:0", "--echo") as started:
        drive, nobody = (started.device(f"ultra3000:{n}", timeout=0.05) for n in (0, 9))
        assert multidrop("action", drive, "define_home", "--yes").status == 0
        assert multidrop("action", nobody, "define_home", "--yes").status == 4
        assert multidrop("save", f"{nobody},echo=on", "kp").status == 4
        ran = multidrop("action", f"{nobody},echo=on", "define_home", "--yes")
        assert ran.status == 7
        assert "look at the drive" in ran.err
