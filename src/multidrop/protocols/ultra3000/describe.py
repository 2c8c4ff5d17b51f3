"""A frame in one line, for traces and sniffers."""

from __future__ import annotations

from multidrop.protocols.ultra3000.frame import READS, REFUSED, Frame
from multidrop.protocols.ultra3000.messages import (
    LAST_ADDRESS,
    WRITES,
    function_name,
    refusal_meaning,
)


def describe(frame: Frame) -> str:
    """What a frame says, as far as it says it by itself."""
    name = function_name(frame.function)
    head = f"{frame.address} {frame.parameter % REFUSED:03X} {name}"
    if frame.is_refusal:
        return f"{head} refused: {_refusal(frame.data)}"
    if not frame.data:
        return head
    return f"{head} {'=' if frame.function in READS else ':='} {frame.data}"


def _refusal(data: str) -> str:
    return refusal_meaning(int(data, 16)) if len(data) == 2 else f"{data or 'nothing'} ?"


_SHOWN = {code: chr(code) if 0x20 <= code <= 0x7E else f"\\x{code:02X}" for code in range(256)}
_SHOWN |= {ord("\r"): "\\r", ord("\\"): "\\\\"}


def shown(raw: bytes) -> str:
    """Characters as they are, carriage return as `\\r`, bytes that are no characters as `\\x80`."""
    return "".join(map(_SHOWN.__getitem__, raw))


def from_master(frame: Frame) -> bool:
    """Whether a master sent it, as far as a frame shows: many an answer equals its request.

    Two digits in a read are taken for a value, though an array's index looks the same.
    No drive has a broadcast address, so no drive sends it.
    """
    if frame.is_refusal:
        return False
    if frame.address > LAST_ADDRESS:
        return True
    if frame.function in READS:
        return not frame.data
    return bool(frame.data) or frame.function not in WRITES


__all__ = ["describe", "from_master", "shown"]
