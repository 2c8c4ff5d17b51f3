"""`--capture FILE`: the traffic of a command, as a file."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import click

from multidrop.errors import UsageError
from multidrop.io import pcapng
from multidrop.io.capture import CaptureTap, CaptureWriter, Known
from multidrop.io.connection import Target
from multidrop.io.line import Tap
from multidrop.plantfile import PlantDevice


def new_capture(path: str) -> CaptureWriter:
    """A capture in a new file, or in place of an older one: of nothing else. Raises `UsageError`."""
    with contextlib.suppress(OSError):
        file = Path(path)
        if file.is_file() and file.stat().st_size and not is_capture(file):
            raise UsageError(f"{path} is there and no capture; it is not replaced")
    return CaptureWriter.create(path)


def is_capture(path: Path) -> bool:
    """Whether a file begins as a pcapng file does. Raises `OSError`."""
    with path.open("rb") as file:
        return file.read(4) == pcapng.SECTION.to_bytes(4, "little")


def capture_to(taps: list[Tap], target: Target, path: str, others: Sequence[PlantDevice]) -> None:
    """Record what passes on the line of these taps until the command ends. Raises `UsageError`."""
    writer = new_capture(path)
    tap = CaptureTap(
        *(writer, target.protocol, target.settings, target.port, known_devices(target, others)),
        own=target.options.own,
    )
    taps.append(tap)
    click.get_current_context().call_on_close(lambda: end_capture(writer, tap, path))


def known_devices(target: Target, others: Sequence[PlantDevice]) -> list[Known]:
    """The device that is spoken to, and those that a plant file has on its port."""
    known = {
        item.device.address: Known(item.device.address, item.profile.name, item.name)
        for item in others
        if item.device.address is not None
    }
    address = target.name.address
    if address is not None and address not in known:
        known[address] = Known(address, target.profile.name)
    return list(known.values())


def end_capture(writer: CaptureWriter, tap: CaptureTap, path: str) -> None:
    """Write what is left; say so where the file could not take everything."""
    tap.finish()
    writer.close()
    warn_if_incomplete(writer, path)


def warn_if_incomplete(writer: CaptureWriter, path: str) -> None:
    if writer.failed is not None:
        why = writer.failed.strerror
        click.secho(
            f"{path} is incomplete, it ends after {writer.packets} packets: {why}",
            err=True,
            fg="yellow",
        )
