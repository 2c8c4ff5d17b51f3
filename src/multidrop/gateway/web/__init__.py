"""The gateway over HTTP: a page for people, JSON for programs, live values, metrics.

It needs the extra `gateway`; what decides who may ask does not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from multidrop.errors import UsageError

if TYPE_CHECKING:
    from multidrop.gateway.gateway import Gateway
    from multidrop.gateway.web.server import Web


def demand_installed() -> None:
    """Raises `UsageError` where the extra is not installed."""
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as missing:
        raise UsageError(
            f"[http] needs {missing.name}, which is not installed: pip install 'multidrop[gateway]'"
        ) from None


def part(gateway: Gateway) -> Web:
    """What `[http]` switches on. Raises `UsageError` where its settings are not safe."""
    demand_installed()
    from multidrop.gateway.web.server import Web

    return Web(gateway)
