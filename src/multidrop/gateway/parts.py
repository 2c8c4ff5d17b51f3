"""The parts that a plant file switches on, each by its table."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from multidrop.errors import UsageError
from multidrop.gateway.settings import CLASSES, Settings
from multidrop.plant import Plant

PARTS: dict[str, str] = {
    "history": "multidrop.gateway.history.part",
    "faults": "multidrop.gateway.faults.part",
    "passports": "multidrop.gateway.passports",
    "http": "multidrop.gateway.web.part",
    "modbus": "multidrop.gateway.modbus.part",
    "mqtt": "multidrop.gateway.mqtt.part",
}
"""Table -> module, in the order in which they are started. Imported when needed.

`part(gateway) -> Part` makes it, and raises `PortError` where the disk has no room;
`wrong(plant, settings) -> Iterator[str]` says what is wrong with its table, key by key; it opens
no port, asks no server and changes no file.
"""

TELLING = ("history", "mqtt")
"""Those that tell how they are, also that they are off: `/api/status` has each of them."""


def modules_of(plant: Plant, settings: Settings) -> Iterator[Any]:
    """The modules of the parts that are switched on. Raises `UsageError` where one is not installed."""
    wanted = [table for table in CLASSES if getattr(settings, table) is not None]
    for table in wanted:
        if table not in PARTS:
            raise UsageError(f"{plant.file}: [{table}] is not in this version")
    return (import_module(PARTS[table]) for table in PARTS if table in wanted)


def wrong_with_parts(plant: Plant, settings: Settings) -> Iterator[str]:
    """What the parts find wrong with their tables, before anything is opened."""
    for table, module in PARTS.items():
        if getattr(settings, table) is None:
            continue
        try:
            yield from import_module(module).wrong(plant, settings)
        except UsageError as error:  # it is not installed
            yield str(error)
