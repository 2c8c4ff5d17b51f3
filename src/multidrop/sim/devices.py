"""Which simulated device a profile's name stands for."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.sim.line import SimulatedDevice

_MODULES = {  # protocol -> module with `simulated`
    "slink3": "multidrop.sim.slink3",
    "datalink": "multidrop.sim.datalink",
    "ultra3000": "multidrop.sim.ultra3000",
}


def simulated_device(profile: str, address: int, behind: str | None = None) -> SimulatedDevice:
    """A device with default values at `address`. Raises `UsageError` for an unknown profile."""
    found = load_profile(profile)
    protocol = found.protocol
    if protocol not in _MODULES:
        raise UsageError(f"there is no simulated {profile}")
    make: Callable[[Any, Any, Any], SimulatedDevice] = import_module(_MODULES[protocol]).simulated
    return make(found, address, behind)
