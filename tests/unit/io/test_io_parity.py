"""The marks of a port that reports parity errors (PARMRK): split from the stream, however it is cut."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.io.parity import ParityMarks

Piece = tuple[bytes, bool]


def marked(pieces: list[Piece]) -> bytes:
    """The stream as the kernel delivers it: FFh doubled, a wrong byte behind FFh 00h."""
    out = b""
    for raw, wrong in pieces:
        for byte in raw:
            if wrong:
                out += b"\xff\x00" + bytes([byte])
            else:
                out += bytes([byte]) * (2 if byte == 0xFF else 1)
    return out


def by_byte(pieces: list[Piece]) -> list[tuple[int, bool]]:
    return [(byte, wrong) for raw, wrong in pieces for byte in raw]


@pytest.mark.parametrize(
    ("data", "pieces"),
    [
        (b"\x01\x02", [(b"\x01\x02", False)]),
        (b"\xff\xff", [(b"\xff", False)]),
        (b"\xff\x00\x55", [(b"\x55", True)]),
        (b"\x01\xff\x00\xff\x02", [(b"\x01", False), (b"\xff", True), (b"\x02", False)]),
        (b"\xff\xff\x00\x01", [(b"\xff\x00\x01", False)]),
        (b"\xff\x00\x00\xff\x00\x01", [(b"\x00", True), (b"\x01", True)]),
        (b"\xff\x07", [(b"\xff\x07", False)]),  # no marking port sends this
        (b"", []),
    ],
)
def test_marks(data: bytes, pieces: list[Piece]) -> None:
    assert ParityMarks().split(data) == pieces


PIECES = st.lists(st.tuples(st.binary(min_size=1, max_size=6), st.booleans()), max_size=8)


@given(pieces=PIECES, cuts=st.lists(st.integers(0, 60), max_size=10))
def test_every_byte_comes_out_once_however_the_stream_is_cut(
    pieces: list[Piece], cuts: list[int]
) -> None:
    stream = marked(pieces)
    marks = ParityMarks()
    ends = sorted({min(cut, len(stream)) for cut in cuts} | {len(stream)})
    found: list[Piece] = []
    start = 0
    for end in ends:
        found += marks.split(stream[start:end])
        start = end
    assert by_byte(found) == by_byte(pieces)


def test_a_mark_that_is_cut_waits_for_its_end() -> None:
    marks = ParityMarks()
    assert marks.split(b"\x01\xff") == [(b"\x01", False)]
    assert marks.split(b"\x00") == []
    assert marks.split(b"\x09\x02") == [(b"\x09", True), (b"\x02", False)]
