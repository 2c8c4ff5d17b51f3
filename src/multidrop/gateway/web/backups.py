"""Backups over HTTP: begun, watched, listed, saved as a file, compared. Nothing here writes to a device."""

from __future__ import annotations

import asyncio
import os
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from multidrop.errors import UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.passports import Passports
from multidrop.gateway.settings import PassportSettings
from multidrop.gateway.web import shapes
from multidrop.gateway.web.access import Access, Refused
from multidrop.gateway.web.bodies import body_of, text_of
from multidrop.gateway.web.operations import DEVICE, Operation, Parameter, listed, ref
from multidrop.gateway.web.tokens import Right
from multidrop.io.audit import jsonable
from multidrop.passports.difference import Difference
from multidrop.passports.folder import Listed
from multidrop.passports.passport import Entry, Passport, Unread

TOML = "application/toml"

NAME = Parameter("name", "a passport, by its name in the list")
TO = Parameter("to", "the later passport; without it, what the device held when it was read last")
ALL = Parameter(
    "all", "whether setpoints and commands are compared too", {"type": "boolean", "default": False}
)


class Backups:
    """The operations on the passports of one gateway."""

    def __init__(self, gateway: Gateway, access: Access) -> None:
        self._gateway = gateway
        self._access = access

    def operations(self) -> tuple[Operation, ...]:
        one_device = Parameter("device", "the device", required=True, example="infeed")
        one = "/api/passports/{device}/{name}"
        return (
            Operation("GET", "/api/passports", "The passports of a device, newest first", self.list,
                      parameters=(one_device,), schema=listed(ref("Passport")),
                      statuses=(404, 503)),
            Operation("POST", "/api/passports", "Read all points of a device, and keep them as a passport",
                      self.make, right=Right.WRITE, body=ref("DeviceName"),
                      schema=ref("ReadingAll"), statuses=(404, 409, 503)),
            Operation("GET", one, "A passport, as its file has it", self.text,
                      parameters=(DEVICE, NAME), content=TOML, statuses=(404, 503)),
            Operation("GET", f"{one}/differences", "What a passport and a later one differ in",
                      self.differences, parameters=(DEVICE, NAME, TO, ALL),
                      schema=ref("Differences"), statuses=(404, 503)),
            Operation("GET", "/api/read-all", "How far the last reading of all points of each device is",
                      self.progress, schema=listed(ref("ReadingAll"))),
            Operation("POST", "/api/read-all", "Read all points of a device, for a comparison",
                      self.look, body=ref("DeviceName"), schema=ref("ReadingAll"),
                      statuses=(404, 409, 503)),
            Operation("POST", "/api/read-all/stop", "Stop reading all points of a device", self.stop,
                      body=ref("DeviceName"), schema=ref("ReadingAll"), statuses=(404,)),
        )  # fmt: skip

    @property
    def _passports(self) -> Passports:
        """Raises `Refused` where none are kept."""
        passports = self._gateway.part(Passports)
        if passports is None:
            raise Refused(404, "no passports are kept: [passports] is not in the plant file")
        return passports

    def _known(self, device: str) -> str:
        """Raises `Refused`."""
        if device not in self._gateway.plant.devices:
            raise Refused(404, f"there is no device {device!r}")
        return device

    # -- reading all of a device -------------------------------------------------------------

    async def make(self, request: Request) -> Response:
        return await self._begin(request, keep=True)

    async def look(self, request: Request) -> Response:
        return await self._begin(request, keep=False)

    async def _begin(self, request: Request, *, keep: bool) -> Response:
        device = text_of(await body_of(request, ("device",)), "device")
        passports, token = self._passports, request.state.token
        who = None if token is None else token.name
        taking = await passports.take(self._known(device), keep=keep, who=who)
        return JSONResponse(shapes.taking(taking))

    async def stop(self, request: Request) -> Response:
        """What leaves a passport needs the right to make one."""
        device = text_of(await body_of(request, ("device",)), "device")
        passports = self._passports
        running = passports.takings.get(self._known(device))
        if running is not None and running.keep:
            self._access.who(request.headers, Right.WRITE)
        return JSONResponse(shapes.taking(await passports.stop(device)))

    async def progress(self, request: Request) -> Response:
        return JSONResponse(shapes.readings(self._gateway))

    # -- what is kept ------------------------------------------------------------------------

    async def list(self, request: Request) -> Response:
        device = request.query_params.get("device")
        if device is None:
            raise UsageError("device is missing")
        found = await self._passports.listed(self._known(device))
        return JSONResponse([self._listed(device, item) for item in found])

    def _listed(self, device: str, item: Listed) -> dict[str, Any]:
        settings = self._gateway.settings.passports or PassportSettings()
        return {
            "device": device,
            "name": item.path.name,
            "path": os.path.join(settings.path, item.path.name),
            "made_as": item.device or None,
            "time": None if item.time is None else shapes.utc(item.time),
            "points": item.points,
            "unreadable": item.unreadable,
            "damage": item.damage,
        }

    async def text(self, request: Request) -> Response:
        device, name = request.path_params["device"], request.path_params["name"]
        path = await self._passports.path(self._known(device), name)
        try:
            text = await asyncio.to_thread(path.read_bytes)
        except OSError as error:
            raise Refused(503, f"{name} cannot be read: {error.strerror}") from None
        saved_as = {"content-disposition": "attachment"}  # the page gives the name
        return Response(text, media_type=TOML, headers=saved_as)

    async def differences(self, request: Request) -> Response:
        device, query = self._known(request.path_params["device"]), request.query_params
        before, after, found = await self._passports.compared(
            device,
            request.path_params["name"],
            query.get("to"),
            everything=_yes_or_no(query.get("all", "false"), "all"),
        )
        return JSONResponse(
            {
                "before": _compared(before, request.path_params["name"]),
                "after": _compared(after, query.get("to")),
                "differences": [_difference(item) for item in found],
            }
        )


def _yes_or_no(text: str, name: str) -> bool:
    if text not in ("true", "false"):
        raise UsageError(f"{name} is {text!r}, which is neither true nor false")
    return text == "true"


def _compared(passport: Passport, name: str | None) -> dict[str, Any]:
    return {
        "name": name,
        "made_as": passport.device,
        "time": shapes.utc(passport.time),
        "points": len(passport.points),
        "unreadable": len(passport.unreadable),
    }


def _difference(item: Difference) -> dict[str, Any]:
    known = item.before or item.after
    assert known is not None
    return {
        "point": item.point,
        "name": item.name,
        "role": known.role.value,
        "before": _side(item.before),
        "after": _side(item.after),
    }


def _side(item: Entry | Unread | None) -> dict[str, Any] | None:
    """None where a side does not have the point at all; `reason` where it could not be read."""
    if isinstance(item, Entry):
        value = jsonable(item.value)
        return {"value": value, "unit": item.unit, "type": item.type, "reason": None}
    if item is None:
        return None
    return {"value": None, "unit": None, "type": None, "reason": item.reason}
