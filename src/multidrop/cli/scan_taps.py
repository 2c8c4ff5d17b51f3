"""What `multidrop scan` shows and records of the traffic, protocol after protocol."""

from __future__ import annotations

import sys
from typing import Protocol

from multidrop.cli.capturing import new_capture, warn_if_incomplete
from multidrop.cli.trace import Trace
from multidrop.device import ProtocolModule
from multidrop.io.capture import CaptureTap
from multidrop.io.line import Tap
from multidrop.timing import LineSettings


class OneSetting(Protocol):
    """A protocol at one setting of a port: a round of a scan, a visit of a doctor."""

    @property
    def module(self) -> ProtocolModule: ...
    @property
    def settings(self) -> LineSettings: ...


class RoundTaps:
    """The taps of each round: a trace, and an interface of its own in the capture."""

    def __init__(self, port: str, *, trace: bool, capture: str | None) -> None:
        """Raises `UsageError` where the capture cannot be written."""
        self._port = port
        self._trace = trace
        self._path = capture or ""
        self._writer = new_capture(capture) if capture else None
        self._open: list[Trace | CaptureTap] = []

    def __call__(self, round: OneSetting) -> list[Tap]:
        self._finish()
        module, settings = round.module, round.settings
        if self._trace:
            self._open.append(Trace(module, settings.decoder, sys.stderr))
        if self._writer is not None:
            self._open.append(CaptureTap(self._writer, module, settings, self._port))
        return list(self._open)

    def close(self) -> None:
        """Write what is left; say so where the file could not take everything."""
        self._finish()
        if self._writer is not None:
            self._writer.close()
            warn_if_incomplete(self._writer, self._path)

    def _finish(self) -> None:
        for tap in self._open:
            tap.finish()
        self._open = []
