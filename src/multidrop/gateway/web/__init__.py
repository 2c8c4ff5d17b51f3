"""The gateway over HTTP: a page for people, JSON for programs, live values, metrics.

It needs the extra `gateway`; `Web` is the part of a gateway that serves it.
"""

from __future__ import annotations

from multidrop.errors import UsageError

try:
    import starlette  # noqa: F401
    import uvicorn  # noqa: F401
except ImportError as missing:  # pragma: no cover - tried without the extra
    raise UsageError(
        f"[http] needs {missing.name}, which is not installed: pip install 'multidrop[gateway]'"
    ) from None

from multidrop.gateway.gateway import Gateway
from multidrop.gateway.web.server import Web


def part(gateway: Gateway) -> Web:
    """What `[http]` switches on. Raises `UsageError` where its settings are not safe."""
    return Web(gateway)


__all__ = ["Web", "part"]
