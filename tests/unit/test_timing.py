"""Character times, gaps and limits."""

from __future__ import annotations

import pytest

from multidrop.errors import UsageError
from multidrop.protocols import datalink
from multidrop.protocols.slink3 import LINE
from multidrop.timing import Format, LineSettings


@pytest.mark.parametrize(
    ("text", "bits"),
    [("8E1", 11), ("8N1", 10), ("8o2", 12), (" 7E1 ", 10), ("7N1", 9), ("7O2", 11)],
)
def test_bits_of_a_character(text: str, bits: int) -> None:
    character = Format.parse(text)
    assert character.bits == bits
    assert str(character) == text.strip().upper()


@pytest.mark.parametrize("text", ["", "9E1", "8X1", "8E3", "8E", "E81", "8E1 8E1"])
def test_no_format(text: str) -> None:
    with pytest.raises(UsageError, match="is not of the form 8E1"):
        Format.parse(text)


def test_the_documents_line() -> None:
    """A chapter 12: 9600 8E1, 11 bits a character, 1.145 ms."""
    assert str(LINE.format) == "8E1"
    assert pytest.approx(0.001145833, abs=1e-9) == LINE.character
    assert (LINE.gap, LINE.byte_gap, LINE.answer) == (0.002, 0.006, 1.5)


def test_a_typed_read_with_an_instant_answer_takes_29_5_ms() -> None:
    request, answer = 11, 13
    assert (request + answer) * LINE.character + LINE.gap == pytest.approx(0.0295)


def test_what_a_master_waits_for_on_a_serial_port_and_behind_a_network() -> None:
    serial, network = LINE.timing(network=False), LINE.timing(network=True)
    assert serial.answer == pytest.approx(1.520)
    assert network.answer == pytest.approx(1.800)
    assert serial.silence == pytest.approx(0.0011458 + 0.006 + 0.030, abs=1e-6)
    assert network.silence == pytest.approx(0.0011458 + 0.006 + 0.300, abs=1e-6)
    assert (serial.gap, serial.longest_frame, serial.attempts) == (0.002, 255, 3)


def test_the_silence_follows_the_baud_rate_downwards_only() -> None:
    """At 4800 baud a gap in a frame may be twice as long; at 38400 an adapter is no quicker."""
    slow = LINE.with_options(baud=4800).timing(network=False)
    fast = LINE.with_options(baud=38400).timing(network=False)
    assert slow.silence == pytest.approx(11 / 4800 + 0.012 + 0.030)
    assert fast.silence == pytest.approx(11 / 38400 + 0.006 + 0.030)


def test_a_gap_that_the_document_gives_in_milliseconds_stays_at_slow_baud_rates() -> None:
    """Datalink's 100 ms are a time whatever the baud rate."""
    slow = datalink.LINE.with_options(baud=110).timing(network=False)
    assert slow.silence == pytest.approx(11 / 110 + 0.100 + 0.090)


@pytest.mark.parametrize(("baud", "more"), [(110, 0.1), (4800, 11 / 4800), (9600, 0), (19200, 0)])
def test_the_first_byte_of_an_answer_takes_its_time_on_a_slow_line(baud: int, more: float) -> None:
    """It is heard at its end: at 110 baud 100 ms after it began."""
    for settings, answer in ((datalink.LINE, 0.100), (LINE, 1.520)):
        timing = settings.with_options(baud=baud).timing(network=False)
        assert timing.answer == pytest.approx(answer + more)


def test_the_user_sets_the_whole_time() -> None:
    timing = LINE.with_options(timeout=0.3, silence=0.05, attempts=1).timing(network=True)
    assert (timing.answer, timing.silence, timing.attempts) == (0.3, 0.05, 1)


def test_options_that_are_none_change_nothing() -> None:
    assert LINE.with_options(baud=None, timeout=None) == LINE


@pytest.mark.parametrize("baud", [50, 4_000_000])
def test_the_limits_of_the_baud_rate(baud: int) -> None:
    assert LINE.with_options(baud=baud).baud == baud


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"baud": 49}, "baud rate 49 is out of range"),
        ({"baud": 4_000_001}, "baud rate 4000001 is out of range"),
        ({"attempts": 0}, "attempts=0: at least 1"),
        ({"timeout": 0.0}, "timeout=0 s is out of range"),
        ({"timeout": 60.1}, "timeout=60.1 s is out of range"),
        ({"timeout": float("nan")}, "timeout=nan s is out of range"),
        ({"silence": -1.0}, "silence=-1 s is out of range"),
    ],
)
def test_settings_out_of_range(options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        LINE.with_options(**options)


def test_settings_are_values() -> None:
    assert LineSettings(**{name: getattr(LINE, name) for name in LINE.__slots__}) == LINE
