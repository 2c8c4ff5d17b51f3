"""A device used through a blocking connection, and through an asyncio one: the same calls."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import multidrop

Call = tuple[Any, ...]  # the name of a connection's method, and its arguments


def blocking(device: str, *calls: Call) -> list[Any]:
    with multidrop.connect(device) as connection:
        return [getattr(connection, name)(*arguments) for name, *arguments in calls]


def in_asyncio(device: str, *calls: Call) -> list[Any]:
    return asyncio.run(_in_asyncio(device, *calls))


async def _in_asyncio(device: str, *calls: Call) -> list[Any]:
    async with multidrop.connect_async(device) as connection:
        return [await getattr(connection, name)(*arguments) for name, *arguments in calls]


Way = Callable[..., list[Any]]
"""`way(device, call, ...)` opens the device, makes the calls, closes it, and returns their results."""

WAYS = (blocking, in_asyncio)


def value_of(device: str, point: str) -> Any:
    """What a point holds now."""
    return blocking(device, ("read", point))[0].value


def state_of(device: str) -> Any:
    """The DRIVECOM state of a drive now."""
    return blocking(device, ("status",))[0].fields["state"]
