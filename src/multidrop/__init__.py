"""multidrop speaks to decades-old drives and controllers on RS-485, as master and as slave.

::

    import multidrop

    with multidrop.connect("flexmax:0@/dev/ttyUSB0") as drive:
        drive.read("8236:int16").value
        drive.write("8236:int16", 1234)

multidrop is not a safety function: stop and enable circuits are wired.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from multidrop import errors
from multidrop.errors import (
    DeviceError,
    Error,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    PortError,
    ProtocolError,
    UsageError,
)

if TYPE_CHECKING:
    from multidrop.io.async_connection import connect_async
    from multidrop.io.async_line import open_async_line
    from multidrop.io.connection import connect
    from multidrop.io.line import open_line
    from multidrop.points import Reading

__version__ = "0.1.0"

_LAZY = {  # so that the pure floors can be imported without the world
    "connect": "multidrop.io.connection",
    "connect_async": "multidrop.io.async_connection",
    "open_async_line": "multidrop.io.async_line",
    "open_line": "multidrop.io.line",
    "Reading": "multidrop.points",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'multidrop' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_LAZY[name]), name)


__all__ = [
    "DeviceError",
    "Error",
    "NoReply",
    "NotApplied",
    "OutcomeUnknown",
    "PortError",
    "ProtocolError",
    "Reading",
    "UsageError",
    "connect",
    "connect_async",
    "errors",
    "open_async_line",
    "open_line",
]
