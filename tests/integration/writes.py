"""What tests of writing share: a slave whose mistakes are known, and the audit log."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from integration.processes import Ran, multidrop
from integration.servers import answering, reply_to
from multidrop.protocols.slink3 import Command, Frame

WRITTEN = ["v", "device", "point", "name", "old", "asked", "found", "raw", "outcome", "time"]
FAST = "timeout=0.4,attempts=1"
WRITE, READ = Command.WRITE_TYPED_PARAMETER, Command.READ_TYPED_PARAMETER


def logged(audit: Path) -> list[dict[str, Any]]:
    """The lines of the audit log."""
    return [json.loads(line) for line in audit.read_text().splitlines()] if audit.exists() else []


class Memory:
    """A slave that reads 1009, and takes writes as it is told to: what it did is known."""

    def __init__(
        self, *, takes: bool = True, answers_writes: int | None = 0, reads: int = 99
    ) -> None:
        self.value = 125
        self.writes = 0
        self._takes, self._code, self._reads = takes, answers_writes, reads

    def __call__(self, request: Frame) -> Frame | None:
        if request.code == WRITE:
            self.writes += 1
            if self._takes:
                self.value = struct.unpack("<h", request.data[3:])[0]
            return None if self._code is None else reply_to(request, self._code)
        self._reads -= 1
        if self._reads < 0:
            return None
        return reply_to(request, 0, request.data[:3] + struct.pack("<h", self.value))


def written_to(memory: Memory, *arguments: str) -> Ran:
    with answering(memory) as server:
        return multidrop("write", f"ax-v:2@{server.port},{FAST}", *arguments)
