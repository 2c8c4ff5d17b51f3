"""What the command line shows: live rows, trends, traces, errors."""

from __future__ import annotations

import io
from typing import Any

import pytest

from multidrop.cli.failures import failure, report_failure
from multidrop.cli.live import BARS, TREND, LiveTable, Row, sparkline
from multidrop.cli.trace import Trace
from multidrop.errors import (
    DeviceError,
    Error,
    NoReply,
    OutcomeUnknown,
)
from multidrop.protocols import PROTOCOLS


def test_a_failure_has_its_kind() -> None:
    assert failure(NoReply(3)) == {"kind": "no-reply", "text": "no reply in 3 attempts"}


def test_a_refusal_has_its_code() -> None:
    assert failure(DeviceError(1, "no")) == {"kind": "refused", "code": 1, "text": "no"}


@pytest.mark.parametrize(
    ("error", "advice"),
    [
        (NoReply(3), "check address, baud rate, format and wiring"),
        (NoReply(3, (b"\x01",)), "bytes come, but damaged"),
        (OutcomeUnknown("x", step="y"), "look at the device before you write again"),
    ],
)
def test_advice(error: Error, advice: str, capsys: pytest.CaptureFixture[str]) -> None:
    report_failure(error, "8236")
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("8236: ")
    assert advice in err
    assert len(err.splitlines()) == 2


def test_a_trend() -> None:
    assert sparkline([]) == ""
    assert sparkline([5, 5, 5]) == BARS[0] * 3
    assert sparkline([0, 7]) == BARS[0] + BARS[-1]
    assert sparkline(list(range(8))) == BARS
    assert len(sparkline(list(range(1000)))) == TREND
    assert sparkline([1e308, -1e308, 0]) != ""


@pytest.mark.parametrize("odd", [float("nan"), float("inf"), float("-inf")])
def test_a_trend_with_values_that_are_no_numbers(odd: float) -> None:
    row = Row("speed", "rpm")
    for value in (1.0, odd, 2.0):
        assert row.show(value)
    assert sparkline(row.trend) == BARS[0] + BARS[-1]
    assert row.show(odd)
    assert not row.show(odd)
    assert row.text == f"{odd} rpm"


def test_a_row() -> None:
    row = Row("speed", "rpm")
    assert row.text == "-"
    assert row.show(100)
    assert not row.show(100)
    assert row.text == "100 rpm"
    assert row.show(100, "in fault", bad=True)
    assert row.fail("no reply")
    assert not row.fail("no reply")
    assert row.text == "-"  # the old value is not shown as if it were true
    assert row.show(100)
    assert row.show("text")
    assert list(row.trend) == [100.0] * 4


def test_changes_are_printed_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    row = Row("speed", "rpm")
    with LiveTable("title", [row]) as table:
        row.show(7, "in fault")
        table.changed(row)
        table.refresh()
    out, err = capsys.readouterr()
    assert out.split()[1:] == ["speed", "7", "rpm", "in", "fault"]
    assert err == ""


# -- traces ----------------------------------------------------------------------------------------

READ = bytes.fromhex("01 02 00 0B 00 26 00 03 F1 03 DE")
ANSWER = bytes.fromhex("01 02 00 0D 01 00 00 03 F1 03 7D 00 82")


def traced(*events: Any) -> list[str]:
    out = io.StringIO()
    trace = Trace(PROTOCOLS["slink3"], PROTOCOLS["slink3"].decoder, out)
    for event in events:
        trace(*event)
    trace.finish()
    return out.getvalue().splitlines()


def test_frames_in_both_directions() -> None:
    sent, received = traced((READ, True, 1.0, False), (ANSWER, False, 1.0315, False))
    assert sent.endswith(
        "+0.0 ms > 01 02 00 0B 00 26 00 03 F1 03 DE  | 2 #0 read typed parameter 1009:int16"
    )
    assert "+31.5 ms < 01 02 00 0D" in received
    assert received.endswith("| 2 #0 OK 1009:int16 = 125")


def test_an_answer_in_pieces_is_one_line() -> None:
    assert len(traced(*((ANSWER[at : at + 1], False, 1.0, False) for at in range(13)))) == 1


def test_damage_is_shown_once_it_is_known_for_what_it_is() -> None:
    damaged = ANSWER[:-1] + b"\0"
    (alone,) = traced((damaged, False, 1.0, False))
    assert "< 01 02 00 0D" in alone
    assert "| ! checksum" in alone
    lines = traced((ANSWER[:5], False, 1.0, False), (READ, True, 2.0, False))
    assert ["!" in line for line in lines] == [True, False]


def test_a_byte_that_the_port_marked_is_damage() -> None:
    lines = traced((ANSWER[:4], False, 1.0, False), (b"\x01", False, 1.0, True))
    assert len(lines) == 2
    assert lines[1].endswith("< 01  | ! parity or framing error")
