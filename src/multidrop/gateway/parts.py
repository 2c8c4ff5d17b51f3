"""The parts that a plant file switches on, each by its table."""

from __future__ import annotations

from importlib import import_module

from multidrop.errors import UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.settings import CLASSES

PARTS: dict[str, str] = {
    "history": "multidrop.gateway.history",
    "faults": "multidrop.gateway.faults",
    "passports": "multidrop.gateway.passports",
    "http": "multidrop.gateway.web",
    "modbus": "multidrop.gateway.modbus",
    "mqtt": "multidrop.gateway.mqtt",
}
"""Table -> module with `part(gateway) -> Part`, in the order in which they are started. Imported when needed."""


def add_parts(gateway: Gateway) -> None:
    """Give a gateway all its parts. Raises `UsageError` where one is not installed."""
    wanted = [table for table in CLASSES if getattr(gateway.settings, table) is not None]
    for table in wanted:
        if table not in PARTS:
            raise UsageError(f"{gateway.plant.file}: [{table}] is not in this version")
    for table in PARTS:
        if table in wanted:
            gateway.add(import_module(PARTS[table]).part(gateway))
