"""The command line with Micro-DCI instruments, in processes of its own."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from integration.processes import Ran, Simulator, multidrop, running, simulator
from integration.threads import served
from integration.writes import logged
from multidrop.protocols import datalink
from multidrop.sim.controller import Controller
from multidrop.sim.datalink import SimulatedInstrument
from multidrop.sim.line import SimulatedLine

READING = ["v", "device", "point", "name", "value", "unit", "type", "raw", "fault", "time", "ms"]
WRITTEN = ["v", "device", "point", "name", "old", "asked", "found", "raw", "outcome", "time"]


@pytest.fixture(scope="module")
def vessel() -> Iterator[Simulator]:
    """53mc5000:3 and 53sl6000:4 over TCP; each test writes points of its own."""
    with simulator("53mc5000:3", "53sl6000:4") as started:
        yield started


def sent(ran: Ran) -> list[str]:
    """What the master sent, as a trace describes it."""
    return re.findall(r" > [0-9A-F ]+  \| (.*)", ran.err)


# -- reading -----------------------------------------------------------------------------------


def test_readings_as_json(vessel: Simulator) -> None:
    before = datetime.now(UTC)
    device = vessel.device("53mc5000:3")
    ran = multidrop("read", device, "C103", "l0106", "A8", "mem/0x8002/1", "--json")
    assert (ran.status, ran.err) == (0, "")
    found = ran.objects
    for reading in found:
        assert list(reading) == READING
        time = datetime.fromisoformat(reading["time"])
        assert before - timedelta(seconds=1) <= time <= datetime.now(UTC)
        assert 0 < reading["ms"] < 5000
        assert (reading["v"], reading["device"], reading["fault"]) == (1, device, None)
    shown = [[reading[key] for key in READING[2:8]] for reading in found]
    assert shown == [
        ["C103", "loop0_alarm_limit_1", 100.0, "EU", "real3", "640007"],
        ["L106", "loop0_reverse", True, None, "bool", "01"],
        ["A8", "tag", "SIMULATED", None, "string", b"SIMULATED\0".hex()],
        ["mem/0x8002/1", None, "06", None, "bytes", "06"],
    ]


def test_a_reading_for_a_person(vessel: Simulator) -> None:
    ran = multidrop("read", vessel.device("53mc5000:3"), "loop0_setpoint")
    assert (ran.status, ran.err) == (0, "")
    assert re.fullmatch(r"loop0_setpoint \(C101\) +50 EU +real3 +640006 +\d+\.\d ms\n", ran.out)


def test_a_hundred_points_are_ten_messages(vessel: Simulator) -> None:
    ran = multidrop("read", vessel.device("53mc5000:3"), "C300..C399", "--json", "--trace")
    assert ran.status == 0
    assert [line["point"] for line in ran.objects] == [f"C{n}" for n in range(300, 400)]
    check, *messages = sent(ran)
    assert check == "3 interrogate 8002h/1"
    assert messages == [f"3 interrogate {0x600 + 3 * n:04X}h/30" for n in range(300, 400, 10)]


def test_neighbours_are_read_together_and_shown_in_the_order_given(vessel: Simulator) -> None:
    ran = multidrop("read", vessel.device("53mc5000:3"), "C103", "B338", "C100", "--trace")
    assert [line.split()[1] for line in ran.out.splitlines()] == ["(C103)", "(B338)", "(C100)"]
    assert sent(ran)[1:] == ["3 interrogate 072Ch/12", "3 interrogate 0352h/1"]


def test_map_b_is_read_without_a_check(vessel: Simulator) -> None:
    ran = multidrop("read", vessel.device("53sl6000:4"), "A0", "H0..H4", "--trace")
    assert ran.status == 0
    assert "SIMULATED" in ran.out
    assert not any("8002h" in message for message in sent(ran))
    ran = multidrop("read", vessel.device("53sl6000:4"), "C1")
    assert ran.status == 2
    assert "where map B keeps its C points is in no source" in ran.err


def test_no_instrument(vessel: Simulator) -> None:
    device = vessel.device("53mc5000:5", timeout=0.05, attempts=2)
    ran = multidrop("read", device, "C100", "C600", "--json")
    assert ran.status == 4
    for line in ran.objects:
        assert line["error"]["kind"] == "no-reply"
        assert "memory map identifier" in line["error"]["text"]


def test_a_map_that_is_another(vessel: Simulator) -> None:
    ran = multidrop("read", vessel.device("53mc5000:4"), "C100")
    assert ran.status == 6
    assert "8002h is 0, and map A has 6" in ran.err


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ("C2000", "C2000: map A has C0..C767"),
        ("loop0_setpont", "did you mean 'loop0_setpoint'"),
    ],
)
def test_points_that_do_not_exist_are_refused(point: str, message: str) -> None:
    ran = multidrop("read", "53mc5000:3@tcp://127.0.0.1:1", "C100", point)
    assert (ran.status, ran.out) == (2, "")
    assert message in ran.err


# -- writing -----------------------------------------------------------------------------------


def test_a_bit_is_written_by_change_bits(vessel: Simulator, audit: Path) -> None:
    device = vessel.device("53mc5000:3")
    ran = multidrop("write", device, "L300=1", "--json", "--trace")
    assert ran.status == 0
    found = ran.object
    assert list(found) == WRITTEN
    found.pop("time")
    assert found == {
        "v": 1,
        "device": device,
        "point": "L300",
        "name": None,
        "old": False,
        "asked": True,
        "found": True,
        "raw": "01",
        "outcome": "confirmed",
    }
    check, old, change, acknowledge, *looks = sent(ran)
    assert (check, old) == ("3 interrogate 8002h/1", "3 interrogate 0525h/1")
    assert (change, acknowledge) == ("3 change bits 0525h mask EF state 10", "3 acknowledge")
    assert set(looks) == {old}
    (line,) = logged(audit)
    assert (line["point"], line["old"], line["found"]) == ("L300", False, True)


def test_a_real_and_a_text_are_written_by_change(vessel: Simulator) -> None:
    device = vessel.device("53mc5000:3")
    ran = multidrop("write", device, "C600=1111", "A50=LINE 7", "--trace")
    assert ran.status == 0
    assert re.search(r"^C600 +0 -> 1111 +confirmed$", ran.out, re.MULTILINE)
    assert re.search(r"^A50 +-> LINE 7 +confirmed$", ran.out, re.MULTILINE)
    changes = [message for message in sent(ran) if "change" in message]
    assert changes == [
        "3 change 0D08h := 45 70 0B",
        "3 change 15F4h := 4C 49 4E 45 20 37 00 00 00 00",
    ]
    again = multidrop("read", device, "C600", "A50", "--json").objects
    assert [(line["value"], line["raw"]) for line in again] == [
        (1111.0, "45700b"),
        ("LINE 7", "4c494e45203700000000"),
    ]


def test_a_write_that_is_not_read_back(vessel: Simulator) -> None:
    ran = multidrop("write", vessel.device("53mc5000:3"), "C601=5", "--no-verify", "--json")
    assert (ran.status, ran.object["outcome"], ran.object["found"]) == (0, "unverified", None)


@pytest.mark.parametrize(
    ("device", "assignment", "message"),
    [
        ("53mc5000:3", "C600=1e60", "does not fit a real of 3 bytes"),
        ("53mc5000:3", "L300=2", "is not a bit"),
        ("53mc5000:3", "A50=0123456789A", "is too long for type A: 10 characters"),
        ("53mc5000:3", "mem/0x1000/33=" + "00" * 33, "at most 32 bytes"),
        ("53mc5000:3", "loop0_setpont=3", "did you mean 'loop0_setpoint'"),
        ("53mc5000:3", "L107=1", "read-only in profile 53mc5000"),
        ("53mc5000:3", "loop0_output=5", "--yes says so"),
        ("53mc5000:32", "C600=1", "address 32 is out of range"),
    ],
)
def test_what_is_refused_before_a_port_is_opened(
    device: str, assignment: str, message: str, audit: Path
) -> None:
    ran = multidrop("write", f"{device}@tcp://127.0.0.1:1", assignment)
    assert (ran.status, ran.out) == (2, "")
    assert message in ran.err
    assert not audit.exists() or logged(audit) == []


def test_an_output_is_a_command_that_needs_yes(vessel: Simulator) -> None:
    device = vessel.device("53mc5000:3")
    ran = multidrop("write", device, "loop3_auto_switch=manual", "loop3_output=12.5", "--yes")
    assert ran.status == 0
    assert multidrop("read", device, "C210", "--json").object["value"] == 12.5
    loops = multidrop("status", device, "--json").object["loops"]
    assert [loop["automatic"] for loop in loops] == [True, True, True, False]


def test_nothing_is_written_where_nothing_can_be_read() -> None:
    with simulator("53mc5000:3", "--fault", "other-slave=100%") as bad:
        device = bad.device("53mc5000:3", timeout=0.05, attempts=2)
        ran = multidrop("write", device, "C600=1", "--json", "--trace")
    assert (ran.status, ran.object["outcome"]) == (4, "not-sent")
    assert "no reply" in ran.object["error"]["text"]
    assert not any("change" in message for message in sent(ran))


# -- services ----------------------------------------------------------------------------------


def test_status(vessel: Simulator) -> None:
    device = vessel.device("53mc5000:3")
    ran = multidrop("status", device)
    assert ran.status == 0
    assert re.search(r"^tag +SIMULATED$", ran.out, re.MULTILINE)
    assert re.search(r"^loop 0 +automatic, local setpoint", ran.out, re.MULTILINE)
    found = multidrop("status", device, "--json").object
    assert (found["v"], found["device"], found["fault"]) == (1, device, None)
    assert (found["status_word"], found["state"], found["malfunction_code"]) == (None, None, None)
    assert (found["map"], found["model"]) == ("A", "53MC5000")
    assert "no source" in multidrop("status", vessel.device("53sl6000:4")).out


def test_an_alarm_is_named(vessel: Simulator) -> None:
    device = vessel.device("53mc5000:3")
    multidrop("write", device, "loop2_alarm_limit_1=-5", "--yes")
    found = multidrop("status", device, "--json").object
    assert "loop2_alarm_a" in found["alarms"]


def test_watch_prints_each_change_without_a_terminal() -> None:
    """Made at the keypad: a change by a second master is lost if `watch` asks before its Acknowledge."""
    inside = Controller(3)
    with served(SimulatedLine([SimulatedInstrument(3, inside)], datalink.decoder)) as place:
        device = place.device("53mc5000:3")
        with running("watch", device, "B40", "A51", "--every", "0.02") as watching:
            assert re.fullmatch(r"\d\d:\d\d:\d\d   B40 +0", watching.wait_for("B40"))
            watching.wait_for("A51")
            inside.memory.raw[0x200 + 40] = 126
            assert watching.wait_for("B40").endswith(" 126")
            ran = watching.interrupt()
    assert ran.status == 130
    assert len(ran.out.splitlines()) == 3
    assert ran.err.strip() == "interrupted"


def test_watch_as_json_reads_neighbours_together(vessel: Simulator) -> None:
    device = vessel.device("53mc5000:3")
    with running("watch", device, "C600..C603", "--every", "0.02", "--json", "--trace") as watching:
        for _ in range(8):
            assert list(json.loads(watching.wait_for('"C60'))) == READING
        ran = watching.interrupt()
    assert set(sent(ran)) == {"3 interrogate 8002h/1", "3 interrogate 0D08h/12"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("clear-faults", "{}"), "no command that clears faults"),
        (("reset-comm", "{}"), "no command that resets an instrument's serial interface"),
        (("raw", "{}", "83"), "an Acknowledge belongs to its write"),
        (("save", "{}", "C600"), "keeps no saved values"),
    ],
)
def test_services_that_an_instrument_does_not_have(
    arguments: tuple[str, ...], message: str
) -> None:
    ran = multidrop(*[text.format("53mc5000:3@tcp://127.0.0.1:1") for text in arguments])
    assert (ran.status, ran.out) == (2, "")
    assert message in ran.err


def test_broadcast_is_refused() -> None:
    ran = multidrop("broadcast", "53mc5000@tcp://127.0.0.1:1", "C600=1", "--verify", "3")
    assert ran.status == 2
    assert "Datalink has no broadcast" in ran.err


def test_raw(vessel: Simulator) -> None:
    device = vessel.device("53mc5000:3")
    ran = multidrop("raw", device, "E0 01 02 80")
    assert (ran.status, ran.out) == (0, "3 response 8002h = 06\n")
    found = multidrop("raw", device, "A0", "01", "46", "02", "05", "--json").object
    assert (found["command"], found["memory_address"], found["data"]) == ("change", 0x246, "05")
    assert multidrop("read", device, "B70", "--json").object["value"] == 0  # not acknowledged


def test_lines_that_do_not_stuff(vessel: Simulator) -> None:
    """A frame without 7Eh in it is the same either way."""
    ran = multidrop("read", vessel.device("53mc5000:3", stuffing="off"), "C103", "--json")
    assert (ran.status, ran.object["value"]) == (0, 100.0)
    ran = multidrop("read", vessel.device("53mc5000:3", stuffing="of"), "C103")
    assert ran.status == 2
    assert "stuffing='of' is none of on, off" in ran.err


def test_an_instrument_that_does_not_stuff() -> None:
    """7Eh in a value, and as an LRC, without an inserted 00 behind it."""
    with simulator("53mc5000:3", "--stuffing", "off") as started:
        device = started.device("53mc5000:3", stuffing="off")
        ran = multidrop("write", device, "B126=126", "C103=0x7E", "--json", "--trace")
        assert [line["outcome"] for line in ran.objects] == ["confirmed", "confirmed"]
        assert "> 7E A3 01 7E 02 7E A2  |" in ran.err
        found = multidrop("read", device, "B126", "C103", "--json").objects
        assert [line["value"] for line in found] == [126, 126.0]
        stuffed = started.device("53mc5000:3", timeout=0.1)
        assert multidrop("read", stuffed, "B126").status == 4


def test_a_plant_whose_line_does_not_stuff(tmp_path: Path) -> None:
    plant = tmp_path / "plant.toml"
    plant.write_text(
        '[line.front]\nport = "tcp://127.0.0.1:0"\nstuffing = "off"\n'
        '[line.front.device.vessel]\nprofile = "53mc5000"\naddress = 3\n'
    )
    with running("simulate", str(plant)) as process:
        port = process.wait_for("listening on").split()[-1]
        found = multidrop("read", f"53mc5000:3@{port},stuffing=off", "B126", "--json")
        assert found.object["value"] == 0
        assert (
            "7E 23 01 7E 02 00 A4"
            in multidrop("read", f"53mc5000:3@{port},stuffing=off", "B126", "--trace").err
        )


def test_stuffing_of_what_never_stuffs() -> None:
    ran = multidrop("simulate", "flexmax:0", "--stuffing", "off", "--listen", "tcp://127.0.0.1:0")
    assert ran.status == 2
    assert "unknown key 'stuffing'" in ran.err
