"""What can be asked over HTTP: every operation, and what it answers."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator, Awaitable, Callable

from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse

from multidrop.errors import Error, UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.history.store import MOST_BUCKETS
from multidrop.gateway.web import metrics, past, shapes
from multidrop.gateway.web.access import Access, Refused
from multidrop.gateway.web.backups import Backups
from multidrop.gateway.web.bodies import body_of, text_of
from multidrop.gateway.web.guard import demand_json
from multidrop.gateway.web.live import Live
from multidrop.gateway.web.operations import DEVICE, Operation, Parameter, document, listed, ref
from multidrop.gateway.web.schemas import SCHEMAS, WRITE
from multidrop.gateway.web.tokens import Right
from multidrop.gateway.web.wire import Watch

MOST_LISTENERS = 250
"""Event streams at a time."""

STATUS_EVERY = 1.0
"""s between two events that say how lines and devices are: also a sign of life."""

EVENT_STREAM = "text/event-stream"

POINT = Parameter("point", "a point of it, by its name in the plant file", example="speed")
LINE = Parameter("line", "a line, by its name in the plant file", example="press")
START = Parameter("start", "s since 1970, or ISO 8601 with its zone", required=True)
END = Parameter("end", "the same; not included", required=True)
MOST = Parameter(
    "most",
    "parts of the time",
    {"type": "integer", "minimum": 1, "maximum": MOST_BUCKETS, "default": MOST_BUCKETS},
)
POINTS = Parameter("point", "DEVICE/POINT; may be given more than once", required=True)
TRIP = Parameter("name", "a freeze-frame, by its name in the list")


class Api:
    """The operations on one gateway."""

    def __init__(self, gateway: Gateway, access: Access) -> None:
        self.gateway = gateway
        self.live = Live(gateway.values, shapes.value_text)
        self._access = access
        self._streams = 0
        self._status: tuple[float, str] = (float("-inf"), "")
        self.operations = self._operations()
        self._document = document(self.operations, SCHEMAS)

    def _operations(self) -> tuple[Operation, ...]:
        one = (DEVICE, POINT)
        several = Parameter("device", "only these devices; may be given more than once")
        one_device = Parameter("device", "only this device")
        return (
            Operation("GET", "/health", "Whether the gateway runs, and its lines", self.health,
                      right=None, schema=ref("Health")),
            Operation("GET", "/metrics", "Metrics for Prometheus", self.metrics,
                      content="text/plain"),
            Operation("GET", "/openapi.json", "This document", self.openapi,
                      right=None, schema={"type": "object"}),
            Operation("GET", "/api/plant", "Lines, devices and points", self.plant,
                      schema=ref("Plant")),
            Operation("GET", "/api/status", "How lines and devices are", self.status,
                      schema=ref("Status")),
            Operation("POST", "/api/status", "Ask a device now how it is: state and fault by name",
                      self.ask, body=ref("DeviceName"), schema=ref("State"),
                      statuses=(404, 502, 503, 504)),
            Operation("GET", "/api/values", "The latest value of every point", self.values,
                      parameters=(several,), schema=listed(ref("Value")), statuses=(404,)),
            Operation("GET", "/api/values/{device}/{point}", "The latest value of one point",
                      self.value, parameters=one, schema=ref("Value"), statuses=(404,)),
            Operation("GET", "/api/events", "Values and status as they come (server-sent events)",
                      self.events, parameters=(several,), content=EVENT_STREAM, statuses=(404, 429)),
            Operation("GET", "/api/lines/{line}/frames", "What passes on a line (server-sent events)",
                      self.frames, parameters=(LINE,), content=EVENT_STREAM, statuses=(404, 429)),
            Operation("POST", "/api/read", "Read a point from its device now", self.read,
                      body=ref("PointName"), schema=ref("Reading"), statuses=(404, 502, 503, 504)),
            Operation("POST", "/api/write", "Write a point that the plant file lets be written",
                      self.write, right=Right.WRITE, body=WRITE, schema=ref("Written"),
                      statuses=(404, 502, 503, 504)),
            Operation("GET", "/api/history.csv", "Every sample of some points, as CSV", self.csv,
                      parameters=(POINTS, START, END), content="text/csv", statuses=(404, 503)),
            Operation("GET", "/api/history/{device}/{point}", "What was, in parts of the time",
                      self.history, parameters=(*one, START, END, MOST), schema=ref("History"),
                      statuses=(404, 503)),
            Operation("GET", "/api/faults", "When devices tripped, newest first", self.faults,
                      parameters=(one_device,), schema=listed(ref("Trip")), statuses=(404,)),
            Operation("GET", "/api/faults/{device}/{name}", "What was kept when a device tripped",
                      self.fault, parameters=(DEVICE, TRIP), schema=ref("FreezeFrame"),
                      statuses=(404,)),
            Operation("GET", "/api/rights", "What the caller may do", self.rights,
                      schema=ref("Rights")),
            *Backups(self.gateway, self._access).operations(),
        )  # fmt: skip

    def answering(self, operation: Operation) -> Callable[[Request], Awaitable[Response]]:
        """An operation as a route: rights before it, errors as JSON after it."""

        async def answer(request: Request) -> Response:
            if operation.body is not None:
                demand_json(request.headers)
            if operation.right is not None:
                request.state.token = self._access.who(request.headers, operation.right)
            try:
                _known_parameters(request, operation)
                return await operation.answer(request)
            except Error as error:
                status, body = shapes.failure(error)
                return JSONResponse(body, status)

        return answer

    # -- reading -----------------------------------------------------------------------------

    async def health(self, request: Request) -> Response:
        status, body = shapes.health(self.gateway)
        return JSONResponse(body, status)

    async def metrics(self, request: Request) -> Response:
        return PlainTextResponse(metrics.text(self.gateway), media_type=metrics.CONTENT)

    async def openapi(self, request: Request) -> Response:
        return JSONResponse(self._document)

    async def plant(self, request: Request) -> Response:
        return JSONResponse(shapes.plant(self.gateway))

    async def status(self, request: Request) -> Response:
        return JSONResponse(shapes.status(self.gateway))

    async def values(self, request: Request) -> Response:
        _, text = self.live.since(0, self._devices(request))
        return Response(text or "[]", media_type="application/json")

    async def value(self, request: Request) -> Response:
        device, point = request.path_params["device"], request.path_params["point"]
        update = self.gateway.values.get(device, point)
        if update is None:
            self._found(device, point)
            raise Refused(404, f"nothing was heard of {device} {point} yet")
        return JSONResponse(shapes.value(update))

    async def rights(self, request: Request) -> Response:
        token = request.state.token
        rights = {Right.READ} if token is None else token.rights
        name = None if token is None else token.name
        return JSONResponse({"name": name, "rights": sorted(rights)})

    async def read(self, request: Request) -> Response:
        body = await body_of(request, ("device", "point"))
        device, point = self._found(text_of(body, "device"), text_of(body, "point"))
        reading = await self.gateway.read(device, point)
        return JSONResponse(shapes.read_now(device, reading))

    async def ask(self, request: Request) -> Response:
        device = text_of(await body_of(request, ("device",)), "device")
        self._known_device(device)
        report = await self.gateway.line_of(device).service.device(device).status()
        return JSONResponse({"device": device, "lines": report.lines, "time": shapes.now()})

    # -- what was ----------------------------------------------------------------------------

    async def history(self, request: Request) -> Response:
        kept, query = past.history_of(self.gateway), request.query_params
        device, point = self._found(request.path_params["device"], request.path_params["point"])
        start, end = (
            past.time_of(query.get("start"), "start"),
            past.time_of(query.get("end"), "end"),
        )
        most = past.most_of(query.get("most"))
        return JSONResponse(await past.columns(kept, device, point, start, end, most))

    async def csv(self, request: Request) -> Response:
        kept, query = past.history_of(self.gateway), request.query_params
        names = [name.partition("/") for name in query.getlist("point")]
        points = [self._found(device, point) for device, _, point in names]
        if not 1 <= len(points) <= past.MOST_POINTS:
            raise UsageError(f"1 to {past.MOST_POINTS} points are possible, not {len(points)}")
        start, end = (
            past.time_of(query.get("start"), "start"),
            past.time_of(query.get("end"), "end"),
        )
        rows = past.rows(kept, points, start, end)
        name = {"content-disposition": 'attachment; filename="multidrop.csv"'}
        return StreamingResponse(rows, media_type=past.CSV, headers=name)

    async def faults(self, request: Request) -> Response:
        device = request.query_params.get("device")
        if device is not None:
            self._known_device(device)
        return JSONResponse(await asyncio.to_thread(past.trips, self.gateway, device))

    async def fault(self, request: Request) -> Response:
        device, name = request.path_params["device"], request.path_params["name"]
        self._known_device(device)
        found = await asyncio.to_thread(past.freeze_frame, self.gateway, device, name)
        return JSONResponse(found)

    # -- writing -----------------------------------------------------------------------------

    async def write(self, request: Request) -> Response:
        """Only what the gateway lets be written; a caller who goes away does not stop a write."""
        body = await body_of(request, ("device", "point", "value"))
        device, point = text_of(body, "device"), text_of(body, "point")
        value = body.get("value")
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise UsageError("value is not a number")
        self._found(device, point)
        client = request.client.host if request.client else "?"
        writing = asyncio.ensure_future(
            self.gateway.write(
                device, point, value, who=request.state.token.name, origin=f"http {client}"
            )
        )
        return JSONResponse(shapes.written(device, await asyncio.shield(writing)))

    # -- as it comes -------------------------------------------------------------------------

    async def events(self, request: Request) -> Response:
        return self._stream(request, self._events(self._devices(request)))

    async def frames(self, request: Request) -> Response:
        name = request.path_params["line"]
        if name not in self.gateway.lines:
            raise Refused(404, f"there is no line {name!r}")
        return self._stream(request, self._frames(Watch(self.gateway.lines[name])))

    def _stream(self, request: Request, events: AsyncGenerator[str, None]) -> Response:
        if self._streams >= MOST_LISTENERS:
            raise Refused(429, f"{MOST_LISTENERS} listen already")
        return StreamingResponse(self._counted(request, events), media_type=EVENT_STREAM)

    async def _counted(
        self, request: Request, events: AsyncGenerator[str, None]
    ) -> AsyncGenerator[str, None]:
        """Until its end, or until the token counts no longer."""
        now = asyncio.get_running_loop().time
        self._streams += 1
        asked = now()
        try:
            async with contextlib.aclosing(events):
                async for event in events:
                    if now() - asked >= STATUS_EVERY:
                        asked = now()
                        self._access.who(request.headers, Right.READ)
                    yield event
        except (Refused, UsageError):  # the answer has begun: there is no other way to say so
            return
        finally:
            self._streams -= 1

    async def _events(self, devices: frozenset[str] | None) -> AsyncGenerator[str, None]:
        """First all values, then those that change; `plant` where the plant file was read again."""
        loop = asyncio.get_running_loop()
        number, plant, next_status = 0, self.gateway.plant, loop.time()
        self.live.listeners += 1
        try:
            while not self.live.closed:
                if plant is not self.gateway.plant:
                    plant = self.gateway.plant
                    yield _event("plant", "{}")
                number, text = self.live.since(number, devices)
                if text:
                    yield _event("values", text)
                if loop.time() >= next_status:
                    next_status = loop.time() + STATUS_EVERY
                    yield _event("status", self._status_text(loop.time()))
                await self.live.wait(max(0.0, next_status - loop.time()))
        finally:
            self.live.listeners -= 1

    def _status_text(self, now: float) -> str:
        """Once for all who listen."""
        if now - self._status[0] >= STATUS_EVERY / 2:
            self._status = now, json.dumps(shapes.status(self.gateway), allow_nan=False)
        return self._status[1]

    async def _frames(self, watch: Watch) -> AsyncGenerator[str, None]:
        async for found in watch.pieces():
            if self.live.closed:
                return
            told = {"now": shapes.now(), "left_out": watch.left_out, "transactions": found}
            yield _event("frames", json.dumps(told, allow_nan=False))

    # -- what was asked for ------------------------------------------------------------------

    def _devices(self, request: Request) -> frozenset[str] | None:
        asked = request.query_params.getlist("device")
        for name in asked:
            self._known_device(name)
        return frozenset(asked) or None

    def _known_device(self, name: str) -> None:
        """Raises `Refused`."""
        if name not in self.gateway.plant.devices:
            raise Refused(404, f"there is no device {name!r}")

    def _found(self, device: str, point: str) -> tuple[str, str]:
        """A point that is polled. Raises `Refused`."""
        self._known_device(device)
        if (device, point) not in self.gateway.line_of(device).keys:
            raise Refused(404, f"{device} has no point {point!r} that is polled")
        return device, point


def _known_parameters(request: Request, operation: Operation) -> None:
    known = {item.name for item in operation.parameters}
    for name in request.query_params:
        if name not in known:
            raise UsageError(f"there is no parameter {name!r}")


def _event(name: str, data: str) -> str:
    return f"event: {name}\ndata: {data}\n\n"
