"""What a decoder reports. Damage is an event, never an exception."""

from __future__ import annotations

from typing import Generic, NamedTuple, TypeVar

FrameT = TypeVar("FrameT")


class FrameReceived(NamedTuple, Generic[FrameT]):
    """A whole frame with a right checksum, and the bytes that it was read from."""

    frame: FrameT
    raw: bytes


class Damaged(NamedTuple):
    """Bytes that belong to no frame, and why not."""

    raw: bytes
    reason: str
