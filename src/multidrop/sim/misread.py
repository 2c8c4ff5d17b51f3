"""What a receiver makes of bytes that were sent at another baud rate, format or polarity.

The wire is followed bit by bit: a receiver waits for a falling edge, takes it for a
start bit, and samples the middle of each bit at its own rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from multidrop.timing import Format

REST = 2
"""Characters of rest that stand before and behind what is sent."""


class Setting(NamedTuple):
    """Baud rate and format of one end of a line."""

    baud: int
    format: Format

    def __str__(self) -> str:
        return f"{self.baud} {self.format}"


class Misread(NamedTuple):
    """A byte as it was received. `at` is s from the first sent bit to the received stop bit.

    `wrong` is whether its parity or its stop bit was, which a port can report.
    """

    byte: int
    at: float
    wrong: bool


def misread(data: bytes, sent: Setting, heard: Setting, *, inverted: bool = False) -> list[Misread]:
    """What a receiver at `heard` makes of bytes sent back to back at `sent`.

    `inverted` is for a pair of wires that is swapped.
    """
    rest = [1] * (REST * sent.format.bits)
    levels = rest + [bit for byte in data for bit in _bits(byte, sent.format)] + rest
    if inverted:
        levels = [1 - bit for bit in levels]
    return list(_received(levels, len(rest), sent.baud, heard))


def garbled(data: bytes, sent: Setting, heard: Setting, *, inverted: bool = False) -> bytes:
    """The bytes alone."""
    return bytes(item.byte for item in misread(data, sent, heard, inverted=inverted))


def _bits(byte: int, form: Format) -> list[int]:
    """One character on the wire: start bit, data from the lowest bit on, parity, stop bits."""
    data = [byte >> number & 1 for number in range(form.data_bits)]
    parity = [] if form.parity == "N" else [_parity(data, form)]
    return [0, *data, *parity, *[1] * form.stop_bits]


def _parity(data: list[int], form: Format) -> int:
    return sum(data) % 2 ^ (form.parity == "O")


def _received(levels: list[int], rest: int, baud: int, heard: Setting) -> Iterator[Misread]:
    """Sample levels that last 1/`baud` s each; the first `rest` of them come before anything is sent."""
    form = heard.format
    width = baud / heard.baud  # of a bit of the receiver, in levels
    at, end = 1, len(levels)
    while at < end:
        if not (levels[at - 1] == 1 and levels[at] == 0):
            at += 1
            continue
        samples = [int(at + width * (number + 0.5)) for number in range(form.bits)]
        if levels[min(samples[0], end - 1)]:  # too short for a start bit
            at += 1
            continue
        read = [levels[min(sample, end - 1)] for sample in samples[1:]]
        data = read[: form.data_bits]
        parity_right = form.parity == "N" or read[form.data_bits] == _parity(data, form)
        stop_at = form.data_bits + (form.parity != "N")
        byte = sum(bit << number for number, bit in enumerate(data))
        after = (at + width * (stop_at + 1.5) - rest) / baud
        yield Misread(byte, after, not (parity_right and read[stop_at]))
        at = max(at + 1, samples[stop_at + 1])
        # a receiver that found no stop bit waits for the line to rise: the edge after it is the next start


__all__ = ["Misread", "Setting", "garbled", "misread"]
