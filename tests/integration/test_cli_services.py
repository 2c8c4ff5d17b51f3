"""`clear-faults`, `reset-comm`, `raw`, `broadcast` in processes of their own, and Ctrl-C while they write."""

from __future__ import annotations

from pathlib import Path

import pytest

from integration.processes import Address, multidrop, running, simulator
from integration.servers import Connected, answering, reply_to, serving
from integration.ways import state_of, value_of
from integration.writes import FAST, WRITTEN, Memory, logged
from multidrop.protocols.slink3 import Command


def test_clear_faults(fresh: Address, audit: Path) -> None:
    device = fresh.device("flexmax:0")
    ran = multidrop("clear-faults", device)
    assert ran.status == 0
    assert "not in fault: switch-on disabled; nothing was written" in ran.out
    assert logged(audit) == []
    multidrop("write", device, "65000:uint16=0x2310", "--yes")
    found = multidrop("status", device, "--json").object
    assert (found["fault"], found["state"], found["malfunction_code"]) == (True, "fault", 0x2310)
    ran = multidrop("clear-faults", device, "--json")
    assert ran.status == 0
    assert (ran.object["cleared"], ran.object["was"], ran.object["state"]) == (
        True,
        "fault",
        "switch-on disabled",
    )
    assert multidrop("status", device, "--json").object["fault"] is False
    assert [(line["point"], line["outcome"]) for line in logged(audit)][1:] == [
        ("clear-faults", "confirmed")
    ]


def test_clear_faults_of_a_running_drive_writes_nothing(fresh: Address) -> None:
    """0000h on a running drive is disable voltage: it would coast."""
    device = fresh.device("flexmax:0")
    multidrop("write", device, "control_word=6", "control_word=7", "control_word=15", "--yes")
    assert multidrop("clear-faults", device).status == 0
    assert state_of(device) == "operation enabled"


def test_a_fault_reset_that_is_cut_off_is_unknown(audit: Path) -> None:
    def in_fault(line: Connected) -> None:
        for request in line.requests():
            if request.code != Command.STATUS_WORD:
                return
            line.send(reply_to(request, 0, b"\x08\x02").encode())

    with serving(in_fault) as server:
        assert multidrop("clear-faults", f"flexmax:0@{server.port}").status == 7
    (line,) = logged(audit)
    assert (line["point"], line["outcome"]) == ("clear-faults", "unknown")


def test_reset_comm(fresh: Address, audit: Path) -> None:
    ran = multidrop("reset-comm", fresh.device("flexmax:0"))
    assert ran.status == 0
    assert "faults stay" in ran.out
    assert [(line["point"], line["outcome"]) for line in logged(audit)] == [
        ("reset-comm", "unverified")
    ]
    ran = multidrop("reset", fresh.device("flexmax:0"))
    assert ran.status == 2
    assert "clear-faults" in ran.err
    assert "reset-comm" in ran.err


def test_raw(fresh: Address, audit: Path) -> None:
    device = fresh.device("flexmax:0")
    ran = multidrop("raw", device, "23", "00", "--json")
    assert ran.status == 0
    assert ran.object["response"] == 0
    assert ran.object["data"] == "4002"
    ran = multidrop("raw", device, "dgfc/CDAB1122")
    assert ran.status == 0
    assert "data 11 22" in ran.out
    ran = multidrop("raw", device, "9900")
    assert "0018h unknown command" in ran.out
    assert ran.status == 3
    assert [line["point"] for line in logged(audit)] == [
        "raw 23 00",
        "raw dgfc/CDAB1122",
        "raw 9900",
    ]
    assert multidrop("raw", fresh.device("flexmax:99", timeout=0.05), "2300").status == 4


@pytest.mark.parametrize(
    "command",
    [("status",), ("clear-faults",), ("reset-comm",), ("raw", "2300")],
    ids=lambda c: c[0],
)
def test_a_failure_is_a_json_line(fresh: Address, command: tuple[str, ...]) -> None:
    device = fresh.device("flexmax:99", timeout=0.05)
    ran = multidrop(command[0], device, *command[1:], "--json")
    assert ran.status == 4
    assert device.startswith(ran.object["device"])
    assert ran.object["error"]["kind"] == "no-reply"


def test_a_port_that_cannot_be_opened_is_a_json_line() -> None:
    ran = multidrop("status", "flexmax:0@/no/such/port", "--json")
    assert ran.status == 5
    assert ran.object["error"]["kind"] == "port"


def test_broadcast(fresh: Address, audit: Path) -> None:
    ran = multidrop("broadcast", f"flexmax@{fresh.port}", "8236:int16=321", "--verify", "0,1")
    assert ran.status == 0
    assert [line.split() for line in ran.out.splitlines()] == [
        ["0", "received", "yes", "applied", "yes"],
        ["1", "received", "yes", "applied", "yes"],
    ]
    lines = logged(audit)
    assert [line["device"] for line in lines] == [f"flexmax:{n}@{fresh.port}" for n in (0, 1)]
    assert [(line["old"], line["asked"], line["found"]) for line in lines] == [(0, 321, 321)] * 2
    assert [line["outcome"] for line in lines] == ["confirmed", "confirmed"]


def test_a_slave_that_is_named_twice_is_asked_once(fresh: Address) -> None:
    """Asked again it would not know of the broadcast any more: NO."""
    ran = multidrop("broadcast", f"flexmax@{fresh.port}", "8236:int16=5", "--verify", "0,1,0")
    assert ran.status == 0
    assert [line.split() for line in ran.out.splitlines()] == [
        ["0", "received", "yes", "applied", "yes"],
        ["1", "received", "yes", "applied", "yes"],
    ]


def test_broadcast_as_json(fresh: Address) -> None:
    ran = multidrop("broadcast", f"ax-v@{fresh.port}", "1111=7", "--verify", "2", "--json")
    assert ran.status == 0
    assert list(ran.object)[: len(WRITTEN)] == WRITTEN
    assert ran.object["device"] == f"ax-v:2@{fresh.port}"
    assert (ran.object["outcome"], ran.object["received"], ran.object["applied"]) == (
        "confirmed",
        None,
        True,
    )


def test_a_broadcast_that_is_not_applied(fresh: Address, audit: Path) -> None:
    ran = multidrop("broadcast", f"flexmax@{fresh.port}", "speed_setpoint=9000", "--verify", "0")
    assert ran.status == 8
    assert ran.out.split() == ["0", "received", "yes", "applied", "NO"]
    assert [line["outcome"] for line in logged(audit)] == ["differs"]


def test_a_silent_slave_and_nothing_is_broadcast(fresh: Address, audit: Path) -> None:
    port = f"flexmax@{fresh.port},{FAST}"
    ran = multidrop("broadcast", port, "8236:int16=5", "--verify", "0,9")
    assert ran.status == 4
    assert "slave 9 did not answer, so nothing was broadcast" in ran.err
    assert value_of(fresh.device("flexmax:0"), "8236") == 0
    assert logged(audit) == []
    ran = multidrop("broadcast", port, "8236:int16=5", "--verify", "0,9", "--keep-going")
    assert ran.status == 7
    assert value_of(fresh.device("flexmax:0"), "8236") == 5
    assert [line["outcome"] for line in logged(audit)] == ["confirmed", "unknown"]


# -- Ctrl-C ---------------------------------------------------------------------------------------


def test_ctrl_c_before_the_write_went_out(audit: Path) -> None:
    with (
        answering(lambda request: None) as server,
        running("write", f"ax-v:2@{server.port},timeout=60", "1009=1", "--trace") as writing,
    ):
        writing.wait_for("read typed parameter")
        ran = writing.interrupt()
    assert ran.status == 130
    assert "Traceback" not in ran.err
    assert logged(audit) == []


@pytest.mark.parametrize("keep_going", [(), ("--keep-going",)])
def test_ctrl_c_while_a_write_is_in_flight(keep_going: tuple[str, ...], audit: Path) -> None:
    memory = Memory(answers_writes=None)
    arguments = ("1009=1", "1009=2", "--json", "--trace", *keep_going)
    with (
        answering(memory) as server,
        running("write", f"ax-v:2@{server.port},timeout=60", *arguments) as writing,
    ):
        writing.wait_for("write typed parameter")
        ran = writing.interrupt()
    assert ran.status == 7
    assert "Traceback" not in ran.err
    assert [line["outcome"] for line in ran.objects] == ["unknown", "not-sent"]
    assert memory.writes == 1
    assert [line["outcome"] for line in logged(audit)] == ["unknown"]


@pytest.mark.parametrize(
    "arguments", [("raw", "27 00 03 F1 03 01 00"), ("reset-comm",)], ids=["raw", "reset-comm"]
)
def test_ctrl_c_while_a_command_is_in_flight(arguments: tuple[str, ...], audit: Path) -> None:
    command, *rest = arguments
    with (
        answering(lambda request: None) as server,
        running(command, f"slink3:2@{server.port},timeout=60", *rest, "--trace") as sending,
    ):
        sending.wait_for(" > ")
        ran = sending.interrupt()
    assert ran.status == 7
    assert "Traceback" not in ran.err
    assert [line["outcome"] for line in logged(audit)] == ["unknown"]


def test_ctrl_c_after_a_broadcast_went_out(audit: Path) -> None:
    with (
        simulator("ax-v:2", "--fault", "late-answer=100%", "--late", "0.3") as slow,
        running("broadcast", f"ax-v@{slow.port}", "1009=1", "--verify", "2", "--trace") as sending,
    ):
        sending.wait_for("128 #0 write typed parameter")
        ran = sending.interrupt()
    assert ran.status == 7
    assert [line["outcome"] for line in logged(audit)] == ["unknown"]
