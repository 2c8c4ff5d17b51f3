"""Checksums, with the examples that the documents print."""

from __future__ import annotations

from multidrop.checksums import negated_sum8, sum8, xor8


def test_xor8() -> None:
    """AX-V manual 5.4.3: the request ends with DDh, the answer with 82h."""
    assert xor8(bytes.fromhex("02 00 0B 00 26 00 00 F1 03")) == 0xDD
    assert xor8(bytes.fromhex("02 00 0D 01 00 00 03 F1 03 7D 00")) == 0x82
    assert xor8(b"") == 0


def test_sum8() -> None:
    """53SL6000 manual p. 125: the sum of all bytes behind SOH, modulo 256."""
    assert sum8(b"") == 0
    assert sum8(b"\xff\x02") == 1


def test_negated_sum8() -> None:
    """Ultra3000: with the checksum the bytes add up to nothing."""
    assert negated_sum8(b"") == 0
    assert negated_sum8(b"\x01") == 0xFF
    assert (sum(b"multidrop") + negated_sum8(b"multidrop")) % 256 == 0
