"""Reals of 3 and 5 bytes: the types C and H (manuals of the family, N).

::

    byte  1 .. size-1                                 size
          mantissa, two's complement, high byte first  exponent, two's complement

The value is mantissa x 2^exponent with 0.5 <= |mantissa| < 1: 64 00 07 is 100,
C0 00 01 is -1. Zero is all zeros, and any zero mantissa reads as 0.
"""

from __future__ import annotations

from math import frexp, isfinite, ldexp

from multidrop.errors import UsageError

_LEAST_EXPONENT, _MOST_EXPONENT = -128, 127


def encode_real(value: float, size: int) -> bytes:
    """The nearest real of `size` bytes, 3 or 5. Raises `UsageError` where it is out of range.

    A tie goes to the even mantissa; what is too small for the least exponent is 0.
    """
    bits = 8 * (size - 1) - 1  # of the mantissa, without its sign
    try:
        fraction, exponent = frexp(value)
    except OverflowError:
        raise _out_of_range(value, size) from None
    if not isfinite(fraction):
        raise _out_of_range(value, size)
    mantissa = round(ldexp(fraction, bits))
    if abs(mantissa) == 1 << bits:  # rounded up to 1.0
        mantissa //= 2
        exponent += 1
    if exponent > _MOST_EXPONENT:
        raise _out_of_range(value, size)
    if mantissa == 0 or exponent < _LEAST_EXPONENT:
        return bytes(size)
    return mantissa.to_bytes(size - 1, "big", signed=True) + exponent.to_bytes(
        1, "big", signed=True
    )


def decode_real(raw: bytes) -> float:
    """The value of 3 or 5 bytes, exactly."""
    bits = 8 * (len(raw) - 1) - 1
    mantissa = int.from_bytes(raw[:-1], "big", signed=True)
    return ldexp(mantissa, int.from_bytes(raw[-1:], "big", signed=True) - bits)


def _out_of_range(value: float, size: int) -> UsageError:
    most = ldexp(1.0, _MOST_EXPONENT)
    return UsageError(f"{value} does not fit a real of {size} bytes: under {most:.4g} either way")
