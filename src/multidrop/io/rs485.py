"""The kernel switches the transmitter of an RS-485 port: ioctl TIOCSRS485 (Linux)."""

from __future__ import annotations

import struct
import sys

from multidrop.errors import PortError

TIOCSRS485 = 0x542F
SER_RS485_ENABLED = 1 << 0
SER_RS485_RTS_ON_SEND = 1 << 1

_SERIAL_RS485 = struct.Struct("=8I")  # flags, delays before and after sending (ms), padding


def enable(fd: int, port: str) -> None:
    """Let the driver hold RTS while it sends. Raises `PortError` where it cannot."""
    if sys.platform != "linux":
        raise PortError(f"{port}: direction=kernel exists on Linux only")
    import fcntl

    settings = _SERIAL_RS485.pack(SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND, 0, 0, 0, 0, 0, 0, 0)
    try:
        fcntl.ioctl(fd, TIOCSRS485, settings)
    except OSError as error:
        raise PortError(
            f"{port}: its driver cannot switch the direction ({error.strerror}); "
            "use direction=auto with an adapter that switches by itself"
        ) from None
