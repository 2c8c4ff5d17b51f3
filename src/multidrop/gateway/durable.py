"""How often an SQLite file is made safe against loss of power: once a second, however often it is written.

A transaction that is not is still safe when the process is killed, for the system has it; it is
on the disk with the next one that is.
"""

from __future__ import annotations

import sqlite3
import time

SAFE_EVERY = 1.0
"""s between two transactions that wait for the disk."""


class Durable:
    """For a connection in WAL mode; `choose` before each of its transactions."""

    def __init__(self, file: sqlite3.Connection) -> None:
        self._file = file
        self._last = float("-inf")

    def choose(self) -> None:
        """Whether the transaction that begins now waits for the disk."""
        now = time.monotonic()
        if now - self._last >= SAFE_EVERY:
            self._last = now
            self._file.execute("PRAGMA synchronous = FULL")
        else:
            self._file.execute("PRAGMA synchronous = NORMAL")
