"""Which simulated device a profile's name stands for."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.profile import Profile
from multidrop.sim.line import SimulatedDevice

_MODULES = {  # protocol -> module with `simulated` and `unknown`
    "slink3": "multidrop.sim.slink3",
    "datalink": "multidrop.sim.datalink",
    "ultra3000": "multidrop.sim.ultra3000",
}


def simulated_device(
    profile: str | Profile, address: int, behind: str | None = None
) -> SimulatedDevice:
    """A device with default values at `address`. Raises `UsageError` for an unknown profile."""
    found = load_profile(profile) if isinstance(profile, str) else profile
    if found.protocol not in _MODULES:
        raise UsageError(f"there is no simulated {found.name}")
    module = import_module(_MODULES[found.protocol])
    make: Callable[[Profile, int, str | None], SimulatedDevice] = module.simulated
    return make(found, address, behind)


def unknown_answer(protocol: str) -> Callable[[Any], bytes | None]:
    """What a device of this protocol says to a question that it knows nothing about; None: nothing."""
    answer: Callable[[Any], bytes | None] = import_module(_MODULES[protocol]).unknown
    return answer
