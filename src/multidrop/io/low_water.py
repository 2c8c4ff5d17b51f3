"""Bytes that are left with the system until an answer can be whole.

A device server hands over an answer in pieces, byte by byte at worst, and with many lines in
one loop a wake-up for each piece costs more than all else. A socket's low-water mark
(SO_RCVLOWAT, socket(7)) says how many bytes are worth one. The last byte of an answer is told
as soon as ever; what stays below the mark, an answer that was cut short, is looked for.
"""

from __future__ import annotations

import os
import socket

MANY = 3
"""Pieces of one answer, from which on it pays to have a mark."""

_SO_RCVLOWAT: int = getattr(socket, "SO_RCVLOWAT", 0)  # Windows has none


class LowWater:
    """The mark of one connection. It stays at 1, every byte is told, until an answer came in many pieces."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._mark = 1
        self._pieces = 0
        self.used = False

    def asked(self) -> None:
        """What comes from now on answers another question."""
        self._pieces = 0

    def heard(self) -> None:
        """A piece of an answer came."""
        self._pieces += 1
        if self._pieces == MANY and _SO_RCVLOWAT:
            self.used = True

    def wait_for(self, count: int) -> bool:
        """Be told of so many bytes, and no longer of fewer. Returns whether some may be left there."""
        if count != self._mark:
            self._mark = count
            self._connection.setsockopt(socket.SOL_SOCKET, _SO_RCVLOWAT, count)
        return count > 1

    def look(self, most: int) -> bytes:
        """The bytes that are there, be they fewer."""
        if self._mark == 1:
            return b""
        try:
            return os.read(self._connection.fileno(), most)
        except OSError:  # none; or the connection is gone, which its transport tells
            return b""
