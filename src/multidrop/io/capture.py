"""Captures: the traffic of a line in a pcapng file that Wireshark opens too.

One packet is one frame as the decoder cut it, or one run of damaged bytes, with
the time at which its last byte had passed. Nothing on the line is left out.
docs/reference/capture.md documents the format.
"""

from __future__ import annotations

import errno
import os
import platform
import struct
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import BinaryIO

from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.events import Damaged
from multidrop.io import pcapng
from multidrop.io.captured import RAW, CaptureReader, Interface, Known, Packet
from multidrop.io.cutting import Cut, Cutter, WallClock
from multidrop.timing import LineSettings


class CaptureWriter:
    """Writes a capture, each block with one call, so that a file is never cut in a block.

    A disk that is full, or a reader that has gone, must not break what is being
    captured: the first such error is kept in `failed`, and nothing more is written.
    """

    def __init__(self, file: BinaryIO) -> None:
        """`file` is open for writing, without a buffer."""
        self._file = file
        self._interfaces = 0
        self.packets = 0
        self.failed: OSError | None = None
        system = f"{platform.system()} {platform.release()}"
        self._write(pcapng.section(f"multidrop {version('multidrop')}", system))

    @classmethod
    def create(cls, path: str | Path) -> CaptureWriter:
        """A capture in a new file, or over an old one. Raises `UsageError`."""
        try:
            return cls(open(path, "wb", buffering=0))
        except OSError as error:
            raise UsageError(f"cannot write {path}: {error.strerror}") from None

    def add_line(
        self,
        protocol: ProtocolModule | None,
        settings: LineSettings,
        port: str = "",
        devices: Iterable[Known] = (),
        own: Mapping[str, str] | None = None,
    ) -> int:
        """Describe a line, `own` are the protocol's own keys; returns the number of the line."""
        name = protocol.name if protocol is not None else "raw"
        said: list[pcapng.Option] = [
            (pcapng.INTERFACE_NAME, port.encode()),
            (
                pcapng.INTERFACE_DESCRIPTION,
                f"{name} {settings.baud} {settings.format}".encode(),
            ),
            (pcapng.INTERFACE_SPEED, struct.pack("<Q", settings.baud)),
        ]
        for known in devices:
            line = f"device {known.address} {known.profile} {known.name}".rstrip()
            said.append((pcapng.COMMENT, line.encode()))
        for key, value in (own or {}).items():
            said.append((pcapng.COMMENT, f"option {key} {value}".encode()))
        link_type = protocol.link_type if protocol is not None else RAW
        self._write(pcapng.interface(link_type, said))
        self._interfaces += 1
        return self._interfaces - 1

    def add(
        self,
        line: int,
        data: bytes,
        time_ns: int,
        *,
        sent: bool | None = None,
        damage: str = "",
        marked: bool = False,
    ) -> None:
        """One frame, or damaged bytes with the reason; `marked` where the port itself said so."""
        flags = 0 if sent is None else pcapng.OUTBOUND if sent else pcapng.INBOUND
        if damage:
            flags |= pcapng.SYMBOL_ERROR if marked else pcapng.UNALIGNED_ERROR
        self._write(pcapng.packet(line, time_ns, data, flags, damage))
        self.packets += self.failed is None

    def _write(self, block: bytes) -> None:
        if self.failed is not None:
            return
        try:
            written = self._file.write(block)
            if written != len(block):  # the disk is full: take back the part
                self._file.seek(-written, os.SEEK_CUR)
                self._file.truncate()
                raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            self.failed = error

    def close(self) -> None:
        self._file.close()


class CaptureTap:
    """A tap on a line that writes what passes into a capture. Call `finish` at the end."""

    def __init__(
        self,
        writer: CaptureWriter,
        protocol: ProtocolModule,
        settings: LineSettings,
        port: str = "",
        devices: Iterable[Known] = (),
        *,
        own: Mapping[str, str] | None = None,
        wall: Callable[[float], int] | None = None,
    ) -> None:
        """`own` are the protocol's own keys; `wall` gives the ns since 1970 of a monotonic time."""
        self._writer = writer
        self._line = writer.add_line(protocol, settings, port, devices, own)
        self._cutter = Cutter(settings, network="://" in port)
        self._wall = wall or WallClock()

    def __call__(self, data: bytes, sent: bool, now: float, damaged: bool) -> None:
        cutter = self._cutter
        self._write(cutter.send(data, now) if sent else cutter.receive(data, now, damaged=damaged))

    def finish(self) -> None:
        """Write what came last and was never followed by anything."""
        self._write(self._cutter.finish())

    def _write(self, cuts: list[Cut]) -> None:
        for cut in cuts:
            write_cut(self._writer, self._line, cut, self._wall(cut.end))


def write_cut(writer: CaptureWriter, line: int, cut: Cut, time_ns: int) -> None:
    """One frame or run of damaged bytes as a packet."""
    damage = cut.event.reason if isinstance(cut.event, Damaged) else ""
    writer.add(line, cut.event.raw, time_ns, sent=cut.sent, damage=damage, marked=cut.marked)


__all__ = [
    "RAW",
    "CaptureReader",
    "CaptureTap",
    "CaptureWriter",
    "Interface",
    "Known",
    "Packet",
    "write_cut",
]
