"""`write` in a process of its own: what is sent, what is said of it, and the audit log."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import pytest

from integration.processes import (
    COMMAND,
    Address,
    Running,
    Simulator,
    multidrop,
    running,
    simulator,
)
from integration.servers import Connected, Server, answering, reply_to, serving
from integration.ways import state_of, value_of
from integration.writes import READ, WRITE, WRITTEN, Memory, logged, written_to
from multidrop.protocols.slink3 import Frame


def test_a_write_for_a_person(fresh: Address, audit: Path) -> None:
    ran = multidrop("write", fresh.device("flexmax:0"), "8236:int16=1234", "speed_setpoint=-100")
    assert (ran.status, ran.err) == (0, "")
    first, second = ran.out.splitlines()
    assert first.split() == ["index_8236", "(8236)", "0", "->", "1234", "confirmed"]
    assert second.split() == [
        "speed_setpoint",
        "(std/0x6042.0)",
        "0",
        "->",
        "-100",
        "rpm",
        "confirmed",
    ]
    assert [line["outcome"] for line in logged(audit)] == ["confirmed", "confirmed"]


def test_a_write_as_json(fresh: Address) -> None:
    ran = multidrop("write", fresh.device("ax-v:2"), "1111=200", "--json")
    assert (ran.status, ran.err) == (0, "")
    found = ran.object
    assert list(found) == WRITTEN
    assert datetime.fromisoformat(found.pop("time")).tzinfo is not None
    assert found == {
        "v": 1,
        "device": f"ax-v:2@{fresh.port}",
        "point": "1111",
        "name": "ipa_1111",
        "old": 100,
        "asked": 200,
        "found": 200,
        "raw": "c800",
        "outcome": "confirmed",
    }


def test_the_audit_log(fresh: Address, audit: Path) -> None:
    multidrop("write", fresh.device("ax-v:2"), "1111=200")
    multidrop("write", fresh.device("ax-v:2"), "1111=0x10", "1009=7", "--no-verify")
    first, second, third = logged(audit)
    assert {"time", "who", "from", "device", "point", "old", "asked", "found", "outcome"} <= set(
        first
    )
    assert first["from"] == "command line"
    assert "@" in first["who"]
    assert first["device"] == f"ax-v:2@{fresh.port}"
    assert (first["point"], first["old"], first["asked"], first["found"]) == ("1111", 100, 200, 200)
    assert (second["old"], second["asked"], second["found"]) == (200, 16, None)
    assert [line["outcome"] for line in (first, second, third)] == [
        "confirmed",
        "unverified",
        "unverified",
    ]
    assert value_of(fresh.device("ax-v:2"), "1111") == 16


def test_an_audit_log_that_cannot_be_written(plant: Simulator, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    elsewhere = str(tmp_path / "file" / "audit.jsonl")
    with answering(Memory()) as server:
        for command in (
            ("write", f"ax-v:2@{server.port}", "1009=1"),
            ("clear-faults", f"flexmax:2@{server.port}"),
            ("reset-comm", f"flexmax:2@{server.port}"),
            ("raw", f"flexmax:2@{server.port}", "2300"),
            ("broadcast", f"ax-v@{server.port}", "1009=1", "--verify", "2"),
        ):
            ran = multidrop(*command, MULTIDROP_AUDIT=elsewhere)
            assert (ran.status, ran.out) == (2, ""), command
            assert "the audit log" in ran.err
            assert "--force" in ran.err
        assert not server.received
    memory = Memory()
    with answering(memory) as server:
        ran = multidrop(
            "write", f"ax-v:2@{server.port}", "1009=1", "--force", MULTIDROP_AUDIT=elsewhere
        )
    assert ran.status == 0
    assert memory.value == 1


# -- what can become of a write -----------------------------------------------------------------


def test_no_answer_to_the_old_value_and_nothing_is_written(audit: Path) -> None:
    memory = Memory(reads=0)
    ran = written_to(memory, "1009=1", "1111=2", "--json")
    assert ran.status == 4
    assert memory.writes == 0
    first, second = ran.objects
    assert (first["outcome"], first["error"]["kind"], first["old"]) == (
        "not-sent",
        "no-reply",
        None,
    )
    assert (second["outcome"], second["error"]["kind"]) == ("not-sent", "not-sent")
    assert logged(audit) == []


def test_a_write_only_point_has_no_old_value() -> None:
    def write_only(request: Frame) -> Frame:
        return reply_to(request, 0 if request.code == WRITE else 0x1A)

    with answering(write_only) as server:
        ran = multidrop("write", f"flexmax:2@{server.port}", "8236=1", "--json")
    assert ran.status == 0
    assert (ran.object["old"], ran.object["found"], ran.object["outcome"]) == (
        None,
        None,
        "unverified",
    )


def test_a_refused_write(plant: Simulator, audit: Path) -> None:
    ran = multidrop("write", plant.device("flexmax:1"), "speed_setpoint=3001", "--json")
    assert ran.status == 3
    assert ran.object["outcome"] == "not-applied"
    assert ran.object["error"] == {"kind": "refused", "code": 0x12, "text": "above the maximum"}
    assert logged(audit)[0]["outcome"] == "not-applied"


@pytest.mark.parametrize("json_too", [False, True])
def test_an_unknown_outcome(json_too: bool, audit: Path) -> None:
    memory = Memory(takes=False, answers_writes=None)
    ran = written_to(memory, "1009=1", *(["--json"] if json_too else []))
    assert ran.status == 7
    assert memory.writes == 1
    if json_too:
        assert (ran.object["outcome"], ran.object["found"]) == ("unknown", 125)
        assert ran.object["error"]["kind"] == "unknown-outcome"
    else:
        assert ran.out.split()[-1] == "unknown"
        assert "confirmed" not in ran.out
        assert "look at the device before you write again" in ran.err
    assert logged(audit)[0]["outcome"] == "unknown"


def test_an_unanswered_write_is_confirmed_by_the_read_back() -> None:
    ran = written_to(Memory(answers_writes=None), "1009=1", "--json")
    assert (ran.status, ran.object["outcome"]) == (0, "confirmed")


def test_a_submitted_write_is_confirmed_by_the_read_back_alone() -> None:
    assert (
        written_to(Memory(answers_writes=0x16), "1009=1", "--json").object["outcome"] == "confirmed"
    )
    ran = written_to(Memory(answers_writes=0x16, takes=False), "1009=1", "--json")
    assert (ran.status, ran.object["outcome"]) == (7, "unknown")


def test_a_read_back_that_differs(audit: Path) -> None:
    ran = written_to(Memory(takes=False), "1009=1", "--json")
    assert ran.status == 8
    assert (ran.object["outcome"], ran.object["asked"], ran.object["found"]) == ("differs", 1, 125)
    assert ran.object["error"]["kind"] == "not-applied"
    assert logged(audit)[0]["outcome"] == "differs"


def test_a_setting_is_tried_once_more_where_it_is_unchanged(tmp_path: Path) -> None:
    own = tmp_path / "mine.toml"
    own.write_text(
        '[profile]\nname = "mine"\nprotocol = "slink3"\ndialect = "ax-v"\n'
        '[points.tension]\nat = "1009:int16"\nrole = "setting"\n'
    )
    memory = Memory(takes=False, answers_writes=None)
    assert written_to(memory, "tension=1", "--profile", str(own)).status == 7
    assert memory.writes == 2


# -- several writes -------------------------------------------------------------------------------


def test_writes_stop_at_the_first_that_is_not_confirmed(fresh: Address) -> None:
    device = fresh.device("flexmax:1")
    ran = multidrop("write", device, "8236=1", "speed_setpoint=3001", "8236=2", "--json")
    assert ran.status == 3
    assert [line["outcome"] for line in ran.objects] == ["confirmed", "not-applied", "not-sent"]
    assert ran.objects[2]["error"]["kind"] == "not-sent"
    assert ran.objects[2]["asked"] == 2
    assert value_of(device, "8236") == 1


def test_keep_going(fresh: Address) -> None:
    device = fresh.device("flexmax:1")
    ran = multidrop("write", device, "speed_setpoint=3001", "8236=2", "--keep-going")
    assert ran.status == 3
    assert ran.out.splitlines()[1].split()[-3:] == ["->", "2", "confirmed"]


def test_the_port_is_lost_between_two_writes() -> None:
    def one_write(line: Connected) -> None:
        memory = Memory()
        for request in line.requests():
            reply = memory(request)
            assert reply is not None
            line.send(reply.encode())
            if memory.writes and request.code == READ:
                return

    with serving(one_write) as server:
        ran = multidrop(
            "write", f"ax-v:2@{server.port}", "1009=1", "1009=2", "1009=3", "--keep-going", "--json"
        )
    assert ran.status == 5
    assert [line["outcome"] for line in ran.objects] == ["confirmed", "not-sent", "not-sent"]
    assert [line["error"]["kind"] for line in ran.objects[1:]] == ["port", "not-sent"]


def test_the_port_is_lost_in_the_middle_of_a_write(audit: Path) -> None:
    def until_written(line: Connected) -> None:
        for request in line.requests():
            if request.code == WRITE:
                return
            line.send(reply_to(request, 0, request.data[:3] + bytes(2)).encode())

    with serving(until_written) as server:
        ran = multidrop(
            "write", f"ax-v:2@{server.port}", "1009=1", "1111=2", "--keep-going", "--json"
        )
    assert ran.status == 7
    assert [line["outcome"] for line in ran.objects] == ["unknown", "not-sent"]
    assert [line["outcome"] for line in logged(audit)] == ["unknown"]


# -- before anything is sent ----------------------------------------------------------------------


@pytest.fixture
def recorder() -> Iterator[Server]:
    """A server that answers nothing and notes every byte."""
    with answering(lambda frame: None) as server:
        yield server


@pytest.mark.parametrize(
    "arguments",
    [
        ("read", "flexmax:0", "8236", "8237.256:int16"),
        ("write", "flexmax:0", "8236:int16=1", "8236:int16=40000"),
        ("write", "flexmax:0", "8236:int16=1", "nonsense=1"),
        ("write", "flexmax:0", "8236:int16=1", "control_word=6"),  # a command, and nobody to ask
        ("watch", "flexmax:0", "8236", "8236:int9"),
        ("raw", "flexmax:0", "2"),
        ("broadcast", "flexmax", "8236:int16=1", "address=9", "--verify", "0"),
        ("broadcast", "flexmax", "8236:int16=1", "--verify", "0,x"),
        ("broadcast", "flexmax", "8236:int16=1", "control_word=6", "--verify", "0", "--force"),
        ("clear-faults", "ax-v:2"),
        ("reset-comm", "dgfc386:2"),
        ("status", "flexmax:128"),
    ],
)
def test_one_usage_error_and_nothing_is_sent(recorder: Server, arguments: tuple[str, ...]) -> None:
    command, who, *rest = arguments
    ran = multidrop(command, f"{who}@{recorder.port}", *rest)
    assert (ran.status, ran.out) == (2, "")
    assert ran.err
    assert len(ran.err.splitlines()) <= 4
    assert not recorder.received
    assert recorder.connections == 0


def test_a_command_needs_yes_where_nobody_can_be_asked(fresh: Address, audit: Path) -> None:
    device = fresh.device("flexmax:0")
    for point in ("control_word", "std/0x6040.0:uint16"):
        ran = multidrop("write", device, f"{point}=6")
        assert ran.status == 2
        assert "--yes" in ran.err
    assert logged(audit) == []
    ran = multidrop("write", device, "control_word=6", "--yes")
    assert ran.status == 0
    assert state_of(device) == "ready to switch on"


def test_a_read_only_point_and_force(fresh: Address) -> None:
    device = fresh.device("flexmax:0")
    ran = multidrop("write", device, "p44:int16=5")
    assert ran.status == 2
    assert "by an inferred rule, so it is read-only; --force writes it" in ran.err
    assert multidrop("write", device, "p44:int16=5", "--force").status == 0
    assert value_of(device, "p44") == 5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_write_that_is_broken_off_is_recorded(audit: Path, number: signal.Signals) -> None:
    """By Ctrl-C, by a service's end, by a terminal that is closed: it went out, so the log has it."""
    with simulator("ax-v:2", "--delay", "1000") as line:
        device = line.device("ax-v:2")
        with running("write", device, "1111=7", "1009=8", "--trace") as program:
            program.wait_for("write typed parameter")
            ran = program.end(number)
    assert ran.status == 7
    assert ran.out.splitlines()[0].endswith("unknown")
    assert "look at the device before you write again" in ran.err
    (entry,) = logged(audit)
    assert (entry["point"], entry["asked"], entry["outcome"]) == ("1111", 7, "unknown")


def test_a_hang_up_that_is_ignored_stays_ignored() -> None:
    """`nohup multidrop ...`"""
    with simulator("ax-v:2") as line:
        asked = f"trap '' HUP; exec {COMMAND} read {line.device('ax-v:2')} 1009 --every 0.05"
        program = Running("sh", "-c", asked)
        try:
            program.wait_for("125")
            program.process.send_signal(signal.SIGHUP)
            program.wait_for("125")
        finally:
            assert program.interrupt().status == 130
