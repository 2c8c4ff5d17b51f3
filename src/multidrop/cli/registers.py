"""`multidrop check --registers`: the register map of the Modbus server."""

from __future__ import annotations

import click

from multidrop.cli.words import json_line
from multidrop.errors import UsageError
from multidrop.gateway.modbus.register_map import Entry, map_of
from multidrop.gateway.settings import settings_of
from multidrop.plantfile import Plant

HOLDING = 400001
"""The number by which many programs call the holding register 0."""

HEAD = ("register", "reference", "type", "device", "point", "unit", "write")


def print_registers(plant: Plant, *, json: bool) -> None:
    """As `run` will have it; nothing is written. Raises `UsageError`."""
    settings = settings_of(plant)
    if settings.modbus is None:
        raise UsageError(f"{plant.file} has no [modbus], so it has no register map")
    path = settings.path(settings.modbus.map)
    filed, wanted = map_of(plant, path)
    ordered = sorted(wanted.entries, key=lambda entry: entry.register)
    if json:
        for entry in ordered:
            click.echo(json_line(_facts(plant, entry, entry in filed.entries)))
        return
    rows = [HEAD, *(_row(plant, entry) for entry in ordered)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEAD))]
    for row in rows:
        cells = [
            cell.rjust(width) if column < 2 else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        click.echo("  ".join(cells).rstrip())
    new = len(wanted.entries) - len(filed.entries)
    if new:
        click.echo(f"{new} not in {path} yet: run adds them", err=True)


def _known(plant: Plant, entry: Entry) -> bool:
    device = plant.devices.get(entry.device)
    return device is not None and entry.point in device.points


def _row(plant: Plant, entry: Entry) -> tuple[str, ...]:
    place = (str(entry.register), str(HOLDING + entry.register), entry.type.value)
    name = (entry.device, entry.point)
    if not _known(plant, entry):
        return (*place, *name, "", "gone")
    device = plant.devices[entry.device]
    limits = device.points[entry.point].write
    write = f"{limits.minimum:g}..{limits.maximum:g}" if limits else "no"
    return (*place, *name, device.profile.points[entry.point].unit or "", write)


def _facts(plant: Plant, entry: Entry, filed: bool) -> dict[str, object]:
    known = _known(plant, entry)
    device = plant.devices[entry.device] if known else None
    limits = device.points[entry.point].write if device else None
    return {
        "register": entry.register,
        "type": entry.type.value,
        "device": entry.device,
        "point": entry.point,
        "unit": device.profile.points[entry.point].unit if device else None,
        "write": {"min": limits.minimum, "max": limits.maximum} if limits else None,
        "gone": not known,
        "filed": filed,
    }
