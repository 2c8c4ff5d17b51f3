"""What a receiver makes of bytes that were sent at another setting."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.sim.misread import Setting, garbled, misread
from multidrop.timing import Format

E81 = Setting(9600, Format(8, "E", 1))
FORMATS = [Format(bits, parity, stop) for bits in (7, 8) for parity in "NEO" for stop in (1, 2)]


@given(st.binary(max_size=20), st.sampled_from(FORMATS), st.sampled_from([110, 1200, 9600, 38400]))
def test_the_same_setting_changes_nothing(data: bytes, form: Format, baud: int) -> None:
    data = bytes(byte & (1 << form.data_bits) - 1 for byte in data)
    setting = Setting(baud, form)
    found = misread(data, setting, setting)
    assert bytes(item.byte for item in found) == data
    assert not any(item.wrong for item in found)


@given(st.binary(max_size=20), st.sampled_from(FORMATS), st.sampled_from(FORMATS), st.booleans())
def test_whatever_comes_is_within_the_time_that_was_sent(
    data: bytes, sent: Format, heard: Format, inverted: bool
) -> None:
    found = misread(data, Setting(9600, sent), Setting(19200, heard), inverted=inverted)
    times = [item.at for item in found]
    assert times == sorted(times)


@given(st.binary(max_size=20), st.sampled_from([0.97, 0.99, 1.01, 1.03]))
def test_a_clock_that_is_a_little_off_does_no_harm(data: bytes, off: float) -> None:
    form = Format(8, "E", 1)
    assert garbled(data, Setting(round(100_000 * off), form), Setting(100_000, form)) == data


@pytest.mark.parametrize(
    ("sent", "data", "heard"),
    [  # worked out by hand: start bit, data from the lowest bit on, even parity, stop bit
        (Setting(4800, Format(8, "N", 1)), "00", "00"),  # 18 low bits are a break, and one byte
        (Setting(2400, Format(8, "N", 1)), "FF", "F8"),
        (Setting(1200, Format(8, "N", 1)), "FF", "80"),
        (Setting(19200, Format(8, "N", 1)), "00", "F8"),  # 4.5 low bits: start and three
        (Setting(9600, Format(8, "N", 1)), "0F F0", "0F F0"),
    ],
)
def test_known_bits(sent: Setting, data: str, heard: str) -> None:
    receiver = Setting(9600, Format(8, "N", 1))
    assert garbled(bytes.fromhex(data), sent, receiver).hex(" ").upper() == heard


def test_another_parity_is_wrong_and_its_bytes_are_right() -> None:
    data = bytes(range(256))
    for parity in "NO":
        found = misread(data, Setting(9600, Format(8, parity, 1)), E81)
        assert bytes(item.byte for item in found) == data
        assert sum(item.wrong for item in found) >= 255  # behind the last one the line rests


def test_a_swapped_pair_turns_the_bits_round() -> None:
    """55h with its parity: swapped it is high for the start bit, every other bit, then high, then rest.

    1 01010101 10: the first fall is the start bit, then come 1010 1011 from the lowest bit on, and
    neither parity nor stop bit are high.
    """
    (found,) = misread(b"\x55", E81, E81, inverted=True)
    assert (found.byte, found.wrong) == (0b11010101, True)


def test_the_time_of_a_byte_is_that_of_its_stop_bit() -> None:
    (one,) = misread(b"\x00", E81, E81)
    assert one.at == pytest.approx(10.5 / 9600)
