"""A frame in one line, for traces and sniffers."""

from __future__ import annotations

from multidrop.protocols.datalink.frame import Command, Frame


def describe(frame: Frame) -> str:
    """What a frame says: a Response holds what was asked for, or echoes a change."""
    command, address, memory_address, count, data = frame
    text = f"{address} {command.name.lower().replace('_', ' ')}"
    if command is Command.ACKNOWLEDGE:
        return text
    text += f" {memory_address:04X}h"
    if command is Command.INTERROGATE:
        return f"{text}/{count}"
    if command is Command.CHANGE_BITS and count % 2 == 0:
        pairs = zip(data[::2], data[1::2], strict=True)
        return text + "".join(f" mask {mask:02X} state {state:02X}" for mask, state in pairs)
    sign = "=" if command is Command.RESPONSE else ":="
    return f"{text} {sign} {data.hex(' ').upper()}".rstrip()
