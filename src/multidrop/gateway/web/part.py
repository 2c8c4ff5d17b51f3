"""The gateway over HTTP: a page for people, JSON for programs, live values, metrics.

It needs the extra `gateway`; what decides who may ask does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from multidrop.errors import UsageError
from multidrop.gateway.settings import Settings, objections
from multidrop.gateway.web.access import (
    certificate_of,
    demand_pair,
    place_of,
    split_address,
    tokens_of,
)
from multidrop.plant import Plant

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


def wrong(plant: Plant, settings: Settings) -> Iterator[str]:
    """What is wrong with `[http]`."""
    http = settings.http
    assert http is not None
    demand_installed()

    def certificate() -> None:
        files = certificate_of(settings)
        if files:
            demand_pair(*files)

    def tokens() -> None:
        try:
            tokens_of(settings).all()
        except UsageError as error:
            raise UsageError(f"http.tokens {error}") from None

    alone = (lambda: split_address(http.listen), certificate, tokens)
    found = list(objections(*alone))
    yield from found or objections(lambda: place_of(settings))
