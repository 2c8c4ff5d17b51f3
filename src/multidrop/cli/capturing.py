"""`--capture FILE`: the traffic of a command, as a file."""

from __future__ import annotations

from collections.abc import Sequence

import click

from multidrop.errors import UsageError
from multidrop.io.capture import CaptureTap, CaptureWriter, Known
from multidrop.io.connection import Target
from multidrop.io.line import Line
from multidrop.plantfile import PlantDevice


def capture_line(line: Line, target: Target, path: str, others: Sequence[PlantDevice]) -> None:
    """Record what passes on a line until the command ends. Raises `UsageError`, the line closed."""
    try:
        writer = CaptureWriter.create(path)
    except UsageError:
        line.close()
        raise
    tap = CaptureTap(
        writer, target.protocol, target.settings, target.port, known_devices(target, others)
    )
    line.taps.append(tap)
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
