"""Frames in one line, for traces."""

from __future__ import annotations

import pytest

from multidrop.protocols.slink3 import Frame
from multidrop.protocols.slink3.describe import describe


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (Frame(1, 0x08, 0, 0x23), "1 #2 status word"),
        (Frame(1, 0, 0, 0x26, b"\x03\x2c\x20"), "1 #0 read typed parameter 8236:int16"),
        (Frame(1, 0, 0, 0x26, b"\x80\x2c\x20\x05"), "1 #0 read typed parameter 8236.5:auto"),
        (Frame(1, 0, 4, 0x26, b"\x05\xff\x01"), "1/2 #0 read typed parameter 511:uint8"),
        (
            Frame(255, 0, 0, 0x27, b"\x03\x2c\x20\xd2\x04"),
            "255 #0 write typed parameter 8236:int16 := 1234",
        ),
        (
            Frame(1, 0, 0, 0x27, b"\x03\x2c\x20\xd2"),
            "1 #0 write typed parameter 8236:int16 := D2 ?",
        ),
        (
            Frame(1, 0, 0, 0x27, b"\x0b\x2c\x20\xd2"),
            "1 #0 write typed parameter 8236:type0Bh := D2 ?",
        ),
        (Frame(1, 0, 0, 0x26, b"\x03"), "1 #0 read typed parameter 03"),
        (Frame(1, 0, 0, 0x24, b"\x41\x60\x00"), "1 #0 read standard parameter std/0x6041.0"),
        (
            Frame(1, 0, 0, 0x25, b"\x40\x60\x00\x06\x00"),
            "1 #0 write standard parameter std/0x6040.0 := 06 00",
        ),
        (Frame(1, 0, 0, 0x25, b"\x40"), "1 #0 write standard parameter 40"),
        (Frame(1, 0, 0, 0xABCD, b"\x11\x22"), "1 #0 special access 11 22"),
        (Frame(1, 0, 0, 0x0123), "1 #0 user defined 0123h"),
        (Frame(1, 0, 1, 0), "1 #0 OK"),
        (Frame(1, 0x3C, 0x15, 0x12), "1/2 #15 FAULT above the maximum"),
        (Frame(1, 0, 1, 0, b"\x03\x2c\x20\xd2\x04"), "1 #0 OK 8236:int16 = 1234"),
        (Frame(1, 0, 1, 0, b"\x09\x2c\x20why?"), "1 #0 OK 8236:string = 'why?'"),
        (Frame(1, 0, 1, 0, b"\x37\x02"), "1 #0 OK 37 02"),
        (Frame(1, 0, 1, 0, b"\x64\x60\x00\x37\x02\x00\x00"), "1 #0 OK 64 60 00 37 02 00 00"),
        (Frame(1, 0, 1, 0, b"\x84\x60\x00\x01\x02\x00\x00\x00"), "1 #0 OK 96.1:int32 = 2"),
        (Frame(1, 0, 1, 0, b"\x03\x2c\x20\xd2"), "1 #0 OK 03 2C 20 D2"),
        (Frame(1, 0, 1, 0, b"\x0b\x2c\x20\xd2"), "1 #0 OK 0B 2C 20 D2"),
    ],
)
def test_describe(frame: Frame, text: str) -> None:
    assert describe(frame) == text
