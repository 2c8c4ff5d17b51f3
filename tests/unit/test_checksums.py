"""Checksums, with the examples that the documents print."""

from __future__ import annotations

from multidrop.checksums import xor8


def test_xor8() -> None:
    """AX-V manual 5.4.3: the request ends with DDh, the answer with 82h."""
    assert xor8(bytes.fromhex("02 00 0B 00 26 00 00 F1 03")) == 0xDD
    assert xor8(bytes.fromhex("02 00 0D 01 00 00 03 F1 03 7D 00")) == 0x82
    assert xor8(b"") == 0
