"""What a change does to memory: the bodies of Change and Change Bits (S p. 125)."""

from __future__ import annotations

from multidrop.protocols.datalink.frame import Command, Frame


def bit_pair(selected: int, wanted: int) -> bytes:
    """Mask and state that bring the `selected` bits of a byte to those of `wanted`, 0..FFh each.

    S: a 0 in the mask forces the bit to 0, then a 1 in the state forces it to 1.
    N: a 0 in the mask lets the state's bit in. Both do the same with this pair.
    """
    return bytes((~selected & 0xFF, wanted & selected))


def extent(change: Frame) -> int:
    """How many bytes of memory a change touches."""
    return change.count // 2 if change.command is Command.CHANGE_BITS else change.count


def applied(change: Frame, old: bytes) -> bytes:
    """What the bytes `old` become: S's formula, (old and mask) or state, for Change Bits."""
    if change.command is not Command.CHANGE_BITS:
        return change.data
    masks, states = change.data[::2], change.data[1::2]
    return bytes(byte & mask | state for byte, mask, state in zip(old, masks, states, strict=True))


def shows(change: Frame, found: bytes) -> bool:
    """Whether memory is as the change wants it."""
    return applied(change, found) == found


def untouched(change: Frame, old: bytes, found: bytes) -> bool:
    """Whether nothing that the change selects differs between `old` and `found`."""
    if change.command is not Command.CHANGE_BITS:
        return old == found
    masks = change.data[::2]
    return all(
        (before ^ after) & ~mask & 0xFF == 0
        for before, after, mask in zip(old, found, masks, strict=True)
    )
