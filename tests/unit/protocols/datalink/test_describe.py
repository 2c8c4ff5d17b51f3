"""Frames in one line."""

from __future__ import annotations

import pytest

from multidrop.protocols.datalink import Frame
from multidrop.protocols.datalink.describe import describe


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        ("7E E3 09 00 10 FC", "3 interrogate 1000h/9"),
        ("7E A3 02 00 10 08 0C C9", "3 change 1000h := 08 0C"),
        ("7E 23 02 00 10 08 0C 49", "3 response 1000h = 08 0C"),
        ("7E 83", "3 acknowledge"),
        (
            "7E C3 04 01 05 BF 40 FE 00 CA",
            "3 change bits 0501h mask BF state 40 mask FE state 00",
        ),
        ("7E C3 01 01 05 BF 89", "3 change bits 0501h := BF"),
        ("7E 23 00 00 10 33", "3 response 1000h ="),
    ],
)
def test_describe(raw: str, text: str) -> None:
    assert describe(Frame.decode(bytes.fromhex(raw))) == text
