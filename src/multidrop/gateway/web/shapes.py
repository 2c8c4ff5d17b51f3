"""How plant, values, health and writes look in JSON. docs/reference/http.md describes the same."""

from __future__ import annotations

from datetime import UTC, datetime
from json import JSONEncoder
from math import isfinite
from typing import Any

from multidrop.errors import (
    DeviceError,
    Error,
    NoReply,
    NotApplied,
    OutcomeUnknown,
    PortError,
    ProtocolError,
    UsageError,
)
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.line import plain
from multidrop.gateway.parts import TELLING
from multidrop.gateway.passports import Busy, NoPassport, NotKept, Passports, Taking
from multidrop.gateway.permission import NotAllowed
from multidrop.gateway.polled import polled, role_of, target_of
from multidrop.gateway.stamps import to_milliseconds
from multidrop.gateway.values import TEXTS, Update
from multidrop.io.audit import jsonable, shown
from multidrop.plantfile import PlantDevice
from multidrop.points import Point, Reading, Role, Value
from multidrop.writing import Written

FAILURES: tuple[tuple[type[Error], int], ...] = (
    (NotAllowed, 403),
    (Busy, 409),
    (NotKept, 503),
    (NoPassport, 404),
    (UsageError, 400),
    (DeviceError, 502),
    (NoReply, 504),
    (ProtocolError, 502),
    (OutcomeUnknown, 502),
    (NotApplied, 502),
    (PortError, 503),
)
"""What went wrong -> HTTP status; the first that fits."""

ENCODE = JSONEncoder(allow_nan=False).encode
"""`json.dumps` with an argument makes an encoder for each call."""

NOT_ALLOWED = "not-allowed"
"""The kind of what the plant file does not allow: HTTP tells that from other misuse, by its status too."""


def failure(error: Error) -> tuple[int, dict[str, Any]]:
    """HTTP status and body of what went wrong."""
    status = next((status for which, status in FAILURES if isinstance(error, which)), 500)
    kind = NOT_ALLOWED if isinstance(error, NotAllowed) else error.kind
    code = getattr(error, "code", None)
    return status, {"error": {"kind": kind, "code": code, "text": str(error)}}


def utc(time: datetime) -> str:
    return to_milliseconds(time)


def now() -> str:
    return utc(datetime.now(UTC))


# -- what there is -------------------------------------------------------------------------------


def plant(gateway: Gateway) -> dict[str, Any]:
    """Lines with their devices with their points, in the order of the plant file."""
    return {
        "lines": [
            {
                "name": line,
                "port": port,
                "devices": [device(found) for found in gateway.plant.on(line)],
            }
            for line, port in gateway.plant.lines.items()
        ],
        "parts": sorted(gateway.parts),
    }


def device(found: PlantDevice) -> dict[str, Any]:
    """One device with all points that are polled."""
    worked_out = target_of(found).device()
    return {
        "name": found.name,
        "line": found.line,
        "protocol": found.profile.protocol,
        "profile": found.profile.name,
        "title": found.profile.title,
        "address": found.device.address,
        "points": [
            point(found, name, every, worked_out.point(name))
            for name, every in polled(found).items()
        ],
    }


def point(found: PlantDevice, name: str, every: float, known: Point) -> dict[str, Any]:
    """One point: what is known of it, and whether it may be written."""
    description = known.description
    named = found.points.get(name)
    role = role_of(found, name) if named else known.role
    write = None
    if named and named.write and (named.motion or role is not Role.COMMAND):
        write = {
            "min": named.write.minimum,
            "max": named.write.maximum,
            "rate": named.write.rate,
            "motion": role is Role.COMMAND,
        }
    return {
        "name": name,
        "at": named.at if named else known.text,
        "type": known.type,
        "unit": known.unit,
        "role": role.value,
        "meaning": description.meaning if description else "",
        "every": every,
        "names": dict(description.names) if description else {},
        "bits": list(description.bits) if description else [],
        "hexadecimal": description is not None and description.hexadecimal,
        "write": write,
    }


# -- how it is -----------------------------------------------------------------------------------


def value(update: Update) -> dict[str, Any]:
    """The latest of a point. `time` is that of the value, `checked` when it was last asked for."""
    reading = update.polled.reading
    error = update.polled.error
    return {
        "device": update.device,
        "point": update.point,
        "value": None if reading is None else jsonable(reading.value),
        "meaning": None if reading is None else reading.meaning,
        "quality": update.quality.value,
        "fault": None if reading is None else reading.fault,
        "time": None if reading is None else utc(reading.time),
        "checked": utc(update.polled.time),
        "error": None if error is None else str(error),
    }


def value_text(update: Update) -> str:
    """`json.dumps(value(update))`, several times as quickly: of every value that is polled."""
    polled = update.polled
    reading, error = polled.reading, polled.error
    if reading is None:
        known, meaning, fault, time = None, None, None, "null"
    else:
        known, meaning, fault = reading.value, reading.meaning, reading.fault
        time = f'"{to_milliseconds(reading.time)}"'
    return (
        f'{{"device": {ENCODE(update.device)}, "point": {ENCODE(update.point)}, '
        f'"value": {_scalar(known)}, "meaning": {_scalar(meaning)}, '
        f'"quality": "{TEXTS[polled.quality]}", "fault": {_scalar(fault)}, "time": {time}, '
        f'"checked": "{to_milliseconds(polled.time)}", '
        f'"error": {"null" if error is None else ENCODE(str(error))}}}'
    )


def _scalar(value: Value | None) -> str:
    """A value as `ENCODE` writes it, which for numbers takes long to begin."""
    if value is None:
        return "null"
    if type(value) is int:
        return repr(value)
    if type(value) is float and isfinite(value):
        return repr(value)
    return ENCODE(jsonable(value))


def read_now(device_name: str, reading: Reading) -> dict[str, Any]:
    """A point that was just read."""
    return {
        "device": device_name,
        "point": reading.name or reading.point,
        "value": jsonable(reading.value),
        "meaning": reading.meaning,
        "unit": reading.unit,
        "type": reading.type,
        "raw": reading.raw_text,
        "fault": reading.fault,
        "time": utc(reading.time),
        "ms": reading.ms,
    }


def status(gateway: Gateway) -> dict[str, Any]:
    """Every line and device: whether it answers, how full, what was counted; how the parts are."""
    return {
        "now": now(),
        **dict.fromkeys(TELLING),
        **{part.name: plain(part.state) for part in gateway.telling()},
        "troubles": troubles(gateway),
        "lines": [plain(line) for line in gateway.line_health()],
        "devices": [plain(gateway.device_health(name)) for name in gateway.plant.devices],
        "readings": readings(gateway),
    }


def troubles(gateway: Gateway) -> list[dict[str, Any]]:
    """What is not recorded or not delivered now."""
    found = [(part.name, part.trouble) for part in gateway.telling()]
    return [
        {
            "part": name,
            "text": trouble.text,
            "since": utc(trouble.since),
            "losing": trouble.losing,
            "hours": trouble.hours,
        }
        for name, trouble in found
        if trouble is not None
    ]


def health(gateway: Gateway) -> tuple[int, dict[str, Any]]:
    """HTTP status and body. Whoever reaches the server may ask, so no error stands in it."""
    lost = sum(line.lost is not None for line in gateway.line_health())
    parts: dict[str, str] = {}
    for part in gateway.telling():
        trouble = part.trouble
        parts[part.name] = "ok" if trouble is None else "failing" if trouble.losing else "waiting"
    failing = "failing" in parts.values()
    well = not lost and set(parts.values()) <= {"ok"}
    word = "failing" if failing else "ok" if well else "degraded"
    return 503 if failing else 200, {"status": word, "lines_lost": lost, "parts": parts}


def readings(gateway: Gateway) -> list[dict[str, Any]]:
    """How far the last reading of all points of each device is."""
    passports = gateway.part(Passports)
    if passports is None:
        return []
    return [
        taking(item) for name, item in passports.takings.items() if name in gateway.plant.devices
    ]


def taking(item: Taking) -> dict[str, Any]:
    """All of a device is being read, or was."""
    return {
        "device": item.device,
        "keep": item.keep,
        "who": item.who,
        "state": item.state.value,
        "points": item.points,
        "done": item.done,
        "unreadable": item.unreadable,
        "started": utc(item.started),
        "ended": None if item.ended is None else utc(item.ended),
        "name": item.name,
        "error": item.error,
    }


def written(device_name: str, record: Written) -> dict[str, Any]:
    """A write that was done."""
    description = record.point.description
    return {
        "device": device_name,
        "point": record.point.name or record.point.text,
        "old": shown(record.old, description),
        "asked": jsonable(record.asked),
        "found": shown(record.found, description),
        "outcome": record.outcome.value,
        "time": now(),
    }
