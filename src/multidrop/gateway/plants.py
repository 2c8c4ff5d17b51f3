"""The plant file of a command: where it is, and what it says."""

from __future__ import annotations

import functools
import os
from pathlib import Path

from multidrop.catalog import CONFIG, CONFIG_ENVIRONMENT, load_profile
from multidrop.gateway.check import demand_right
from multidrop.plantfile import Plant, read_plant


def plant_path(file: str | None) -> Path:
    """The file that was named, else what the environment names, else `multidrop.toml` here."""
    return Path(file or os.environ.get(CONFIG_ENVIRONMENT, CONFIG))


def read(path: Path) -> Plant:
    """A plant file with all that is `wrong` with it. Raises `UsageError` where it cannot be read."""
    return read_plant(path, functools.partial(load_profile, config=path))


def load(path: Path) -> Plant:
    """A plant file in which nothing is wrong. Raises `UsageError` with all that is."""
    plant = read(path)
    demand_right(plant)
    return plant
