"""Actions, saved values and bytes of memory, as far as no device is needed to see them."""

from __future__ import annotations

import json

import pytest

from multidrop.cli.writing import show_record
from multidrop.errors import NoReply
from multidrop.profile import Profile
from multidrop.protocols.datalink.memory import MAP_A
from multidrop.protocols.datalink.points import Points
from multidrop.writing import Outcome, Written
from unit.cli.conftest import CommandLine

DRIVE = "ultra3000:0@tcp://127.0.0.1:1"
INSTRUMENT = "53mc5000:3@tcp://127.0.0.1:1"


def test_actions_are_listed_for_people_and_for_programs(command_line: CommandLine) -> None:
    status, out, err = command_line("action", DRIVE)
    assert (status, err) == (0, "")
    assert "define_home          defines the present position as home" in out.splitlines()
    status, as_json, _ = command_line("action", DRIVE, "--json")
    listed = [json.loads(line) for line in as_json.splitlines()]
    assert [line["action"] for line in listed] == [line.split()[0] for line in out.splitlines()]
    assert listed[0]["device"] == DRIVE


def test_nv_where_nothing_is_saved_beside_the_working_values(command_line: CommandLine) -> None:
    status, _, err = command_line("write", INSTRUMENT, "C101=4", "--nv")
    assert status == 2
    assert err == "53mc5000 keeps no saved values beside the working ones\n"


@pytest.mark.parametrize(
    ("outcome", "shown"),
    [(Outcome.CONFIRMED, "00 01 -> 7E 7E   confirmed"), (Outcome.NOT_APPLIED, "00 01 -> 7E 7E   ")],
)
def test_bytes_of_a_write_look_alike(
    capsys: pytest.CaptureFixture[str], outcome: Outcome, shown: str
) -> None:
    point = Points(Profile("datalink", "datalink"), MAP_A).find("mem/0x1000/2")[0]
    error = None if outcome is Outcome.CONFIRMED else NoReply(3, (), (), because="no reply")
    found = point.sample(b"\x7e\x7e") if error is None else None
    show_record(Written(point, b"\x7e\x7e", outcome, point.sample(b"\x00\x01"), found, error))
    assert shown in capsys.readouterr().out
