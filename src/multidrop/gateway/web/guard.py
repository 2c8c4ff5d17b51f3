"""Stands before everything that is served: refuses what must not be asked, and bounds what is sent."""

from __future__ import annotations

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from multidrop.gateway.web.access import Access, Refused

LONGEST_BODY = 64 * 1024
"""Bytes of a request's body: a write has less than a hundred."""

ONCE = ("authorization", "content-length", "content-type", "host", "origin")
"""Headers that decide: two of one might be read as one by us, and as the other by who let it through."""

CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)

ALWAYS = {
    "content-security-policy": CONTENT_POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}
"""Of every answer. Nothing is kept by browsers: an old page beside a new server is a riddle."""


class Guard:
    """Wraps the application."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return
        headers = Headers(scope=scope)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = MutableHeaders(scope=message)
                for name, value in ALWAYS.items():
                    given.setdefault(name, value)
            await send(message)

        try:
            demand_clear(headers)
            self._access.check_origin(headers)
        except Refused as refused:
            await refusal(refused)(scope, receive, with_headers)
        else:
            await self._app(scope, _bounded(receive), with_headers)


def demand_clear(headers: Headers) -> None:
    """Raises `Refused` for a request that can be understood in two ways."""
    for name in ONCE:
        if len(headers.getlist(name)) > 1:
            raise Refused(400, f"{name} is given twice")
    if "content-length" in headers and "transfer-encoding" in headers:
        raise Refused(400, "content-length and transfer-encoding are given both")


def demand_json(headers: Headers) -> None:
    """JSON and nothing else: a form of another site cannot send that without being asked first."""
    kind = headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise Refused(415, f"the content type must be application/json, not {kind or 'none'!r}")


def _bounded(receive: Receive) -> Receive:
    received = 0

    async def bounded() -> Message:
        nonlocal received
        message = await receive()
        received += len(message.get("body", b""))
        if received > LONGEST_BODY:
            raise Refused(413, f"a body has at most {LONGEST_BODY} bytes")
        return message

    return bounded


def refusal(refused: Refused) -> JSONResponse:
    """Everything that went wrong has the same body."""
    body = {"error": {"kind": "request", "code": None, "text": refused.reason}}
    headers = {401: {"www-authenticate": "Bearer"}, 413: {"connection": "close"}}
    return JSONResponse(body, refused.status, headers.get(refused.status))
