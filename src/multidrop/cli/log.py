"""The log of writes of a command: what it could not take is told, and nothing more is written."""

from __future__ import annotations

from typing import Any

import click

from multidrop.cli.words import json_line
from multidrop.errors import UsageError
from multidrop.io.audit import AuditLog


class CommandLog(AuditLog):
    """A log whose disk may fill up behind its check, when a write is already out.

    What became of that write must still be told, so `append` does not raise: it
    says what the log has not, and `demand_whole` raises once all is said.
    """

    missed: OSError | None = None

    def check(self) -> None:
        """Before a write. Raises `UsageError`, also where an earlier one could not be recorded."""
        if self.missed is not None:
            raise UsageError(f"an earlier write is not in {self.path}; nothing more is written")
        super().check()

    def append(self, device: str, point: str, **facts: Any) -> None:
        try:
            super().append(device, point, **facts)
        except OSError as error:
            self.missed = OSError(error.errno, error.strerror, str(self.path))
            line = json_line({"device": device, "point": point, **facts})
            click.secho(f"not in the log of writes: {line}", err=True, fg="red")

    def demand_whole(self) -> None:
        """At the end. Raises `OSError`."""
        if self.missed is not None:
            raise self.missed
