"""What Change and Change Bits do to memory, and the pair that both readings of the mask share."""

from __future__ import annotations

import pytest

from multidrop.protocols.datalink import Command, Frame
from multidrop.protocols.datalink.messages import applied, bit_pair, extent, shows, untouched

CHANGE = Frame(Command.CHANGE, 3, 0x1000, 2, b"\x08\x0c")


def change_bits(pairs: str) -> Frame:
    data = bytes.fromhex(pairs)
    return Frame(Command.CHANGE_BITS, 3, 0x501, len(data), data)


def test_the_pair_is_understood_by_both_readings() -> None:
    for selected in range(256):
        for wanted in range(256):
            mask, state = bit_pair(selected, wanted)
            for old in (0x00, 0xFF, 0x5A):
                forced = old & mask | state  # S
                let_in = old & mask | state & ~mask  # N
                assert forced == let_in
                assert (forced ^ old) & ~selected == 0
                assert (forced ^ wanted) & selected == 0


def test_the_printed_formula() -> None:
    assert applied(change_bits("BF 40 FE 00"), b"\x01\x01") == b"\x41\x00"
    # mask and state both 1: the two readings differ, and an instrument forces the bit to 1
    assert applied(change_bits("FF 40"), b"\x01") == b"\x41"


def test_a_change_replaces_bytes() -> None:
    assert applied(CHANGE, b"\xff\xff") == b"\x08\x0c"


def test_how_many_bytes_of_memory() -> None:
    assert extent(CHANGE) == 2
    assert extent(change_bits("BF 40 FE 00")) == 2
    assert extent(Frame(Command.INTERROGATE, 3, 0, 9)) == 9


@pytest.mark.parametrize(
    ("change", "found", "agrees"),
    [
        (CHANGE, "08 0C", True),
        (CHANGE, "08 0D", False),
        (change_bits("BF 40"), "40", True),
        (change_bits("BF 40"), "FF", True),
        (change_bits("BF 40"), "BF", False),
        (change_bits("BF 00"), "BF", True),
        (change_bits("BF 40 FE 00"), "40 01", False),
    ],
)
def test_whether_memory_shows_it(change: Frame, found: str, agrees: bool) -> None:
    assert shows(change, bytes.fromhex(found)) is agrees


@pytest.mark.parametrize(
    ("change", "old", "found", "same"),
    [
        (CHANGE, "01 02", "01 02", True),
        (CHANGE, "01 02", "01 03", False),
        (change_bits("BF 40"), "00", "BF", True),  # other bits may change by themselves
        (change_bits("BF 40"), "00", "40", False),
        (change_bits("BF 40 FE 01"), "00 00", "00 01", False),
    ],
)
def test_whether_nothing_was_touched(change: Frame, old: str, found: str, same: bool) -> None:
    assert untouched(change, bytes.fromhex(old), bytes.fromhex(found)) is same
