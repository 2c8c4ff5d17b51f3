"""The HTTP server, in the gateway's own loop."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from multidrop.errors import PortError, UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.settings import HttpSettings
from multidrop.gateway.web.access import Access, Place, Refused, place_of, tokens_of
from multidrop.gateway.web.api import Api
from multidrop.gateway.web.guard import Guard, refusal

PAGE = Path(__file__).with_name("page")

MOST_CONNECTIONS = 1000
LONGEST_HEAD = 16 * 1024
"""Bytes of a request's line and headers."""

GRACE = 2
"""s that answers which are under way have when the gateway stops."""


class _Server(uvicorn.Server):
    """Signals are the gateway's."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class Web:
    """The part of a gateway that serves HTTP. Raises `UsageError` where its settings are not safe."""

    name = "http"

    def __init__(self, gateway: Gateway) -> None:
        settings = gateway.settings
        http = settings.http or HttpSettings()
        self._gateway = gateway
        self._place = place_of(settings)
        self._access = Access(self._place, http.names, tokens_of(settings))

    async def run(self) -> None:
        """Until cancelled. Raises `PortError` where it cannot listen."""
        api = Api(self._gateway, self._access)
        with bound(self._place) as listening:
            server = _Server(_config(application(api, self._access), self._place))
            serving = asyncio.create_task(server.serve([listening]))
            try:
                while not server.started and not serving.done():
                    await asyncio.sleep(0.01)
                self._gateway.say(self._place.url(listening.getsockname()[1]))
                await asyncio.shield(serving)
            finally:
                api.live.close()
                server.should_exit = True
                await serving


def application(api: Api, access: Access) -> ASGIApp:
    """Everything that is served, behind its guard."""
    routes = [
        Route(item.path, api.answering(item), methods=[item.method]) for item in api.operations
    ]
    handlers = {HTTPException: _as_json, Refused: _as_json}
    everything = Starlette(routes=routes, exception_handlers=handlers)
    everything.router.default = StaticFiles(directory=PAGE, html=True)
    return Guard(everything, access)


def _as_json(request: Request, error: Exception) -> Response:
    if isinstance(error, HTTPException):  # no such path, no such method
        answer = refusal(Refused(error.status_code, error.detail))
        answer.headers.update(error.headers or {})
        return answer
    assert isinstance(error, Refused)
    return refusal(error)


@contextlib.contextmanager
def bound(place: Place) -> Iterator[socket.socket]:
    """A socket at this place. Raises `PortError`."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            place.host, place.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        # asyncio lets an event go at once, and not 40 ms later, only where a socket says it is TCP
        listening = socket.socket(family, kind, protocol)
    except OSError as error:
        raise PortError(f"http.listen {place.host}: {error.strerror}") from None
    with listening:
        try:
            if os.name == "posix":
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(address)
        except OSError as error:
            busy = error.errno == errno.EADDRINUSE
            hint = ": another program listens there; listen elsewhere in [http]" if busy else ""
            raise PortError(
                f"http.listen {place.host}:{place.port}: {error.strerror}{hint}"
            ) from None
        yield listening


def _config(app: ASGIApp, place: Place) -> uvicorn.Config:
    config = uvicorn.Config(
        app,
        http="h11",
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        limit_concurrency=MOST_CONNECTIONS,
        h11_max_incomplete_event_size=LONGEST_HEAD,
        timeout_graceful_shutdown=GRACE,
        ssl_certfile=place.certificate,
        ssl_keyfile=None if place.key is None else str(place.key),
    )
    try:
        config.load()
    except OSError as error:  # SSLError is one
        raise UsageError(f"{place.certificate}, {place.key}: {error}") from None
    return config
