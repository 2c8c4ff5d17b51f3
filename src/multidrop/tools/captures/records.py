"""What was heard on a line, one record for each point or frame, as JSON, CSV or words."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Any, NamedTuple

from multidrop.errors import DeviceError, NoReply
from multidrop.io.audit import jsonable
from multidrop.observer import Found
from multidrop.points import Point, Sample
from multidrop.tools.captures.listened import Listened
from multidrop.transaction import Damage, Stray, Transaction

_json = json.JSONEncoder(ensure_ascii=False).encode
_quoted = json.encoder.encode_basestring
WallTime = Callable[[float], int]
"""The ns since 1970 of a time that an observer gave."""

DAMAGE, STRAY = "damage", "stray"
REFUSED, NO_REPLY = DeviceError.kind, NoReply.kind
KINDS = ("read", "write", "status", "other", STRAY, DAMAGE, REFUSED, NO_REPLY)
"""What --kind takes; the last two go across the others."""

FIELDS = (
    *("v", "time", "device", "kind", "point", "name", "value", "unit", "type", "raw", "fault"),
    *("ms", "answer_ms", "error", "text"),
)


class Record(NamedTuple):
    """A point that was read or written, a transaction without points, a stray frame or damage."""

    at: float  # when its last byte had passed
    address: int | None
    kind: str
    point: Point | None
    sample: Sample | None
    raw: bytes | None  # of a stray frame or of damage
    fault: bool | None
    ms: float | None  # from the start of the question to the last byte
    answer_ms: float | None  # from the end of the question to the first byte of the answer
    error: dict[str, Any] | None
    text: str

    def is_a(self, kind: str) -> bool:
        return kind == self.kind or (self.error is not None and self.error["kind"] == kind)


def records(found: Found) -> Iterator[Record]:
    """The records of what an observer found."""
    if type(found) is Transaction:
        yield from _of_transaction(found)
    elif type(found) is Stray:
        heard = found.heard
        error = {"kind": STRAY, "text": "answers nothing that was asked"}
        address, raw = heard.frame.address, heard.raw
        yield Record(
            heard.end, address, STRAY, None, None, raw, None, None, None, error, found.text
        )
    elif type(found) is Damage:
        error = {"kind": "damaged", "text": found.reason}
        yield Record(
            *(found.at, None, DAMAGE, None, None, found.raw, None, None, None, error, found.reason)
        )


def _of_transaction(found: Transaction) -> Iterator[Record]:
    frames, meaning, address, answer_ms, _ = found
    kind, text, values, refusal, fault, _, unread = meaning
    end = frames[-1].end
    error: dict[str, Any] | None = None
    ms = None
    if refusal is not None:
        error = {"kind": REFUSED, "code": refusal.code, "text": refusal.text}
    if answer_ms is not None:
        ms = (end - frames[0].start) * 1000
    elif len(frames) == 1 and not meaning.complete:
        error = {"kind": NO_REPLY, "text": "no answer"}
    pairs: Sequence[tuple[Point | None, Sample | None]] = values
    for point, sample in pairs or [(point, None) for point in unread] or [(None, None)]:
        yield Record(
            end, address, kind.value, point, sample, None, fault, ms, answer_ms, error, text
        )


@dataclass(frozen=True, slots=True)
class Filter:
    """Which records are wanted; nothing given lets everything pass. Patterns as in `loop0_*`."""

    devices: tuple[str, ...] = ()  # address, label, or PROFILE:ADDRESS
    points: tuple[str, ...] = ()  # name, or as the grammar has it
    kinds: tuple[str, ...] = ()

    def passes(self, record: Record, line: Listened | None) -> bool:
        return (
            (not self.kinds or any(record.is_a(kind) for kind in self.kinds))
            and (not self.devices or self._device(record, line))
            and (not self.points or self._point(record))
        )

    def _device(self, record: Record, line: Listened | None) -> bool:
        if record.address is None or line is None:
            return False
        device = line.device(record.address)
        called = (str(record.address), line.label(record.address), device, device.split("@")[0])
        return any(fnmatchcase(name, wanted) for wanted in self.devices for name in called)

    def _point(self, record: Record) -> bool:
        if record.point is None:
            return False
        called = [text for text in (record.point.text, record.point.name) if text]
        return any(fnmatchcase(name, wanted) for wanted in self.points for name in called)


# -- JSON and CSV ------------------------------------------------------------------------------


def utc(time_ns: int) -> str:
    """As every time in JSON: UTC with microseconds."""
    seconds, rest = divmod(time_ns, 10**9)
    return f"{_whole_second(seconds)}.{rest // 1000:06d}Z"


@lru_cache(maxsize=2)
def _whole_second(seconds: int) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S")


def fields(record: Record, line: Listened | None, time_ns: int) -> dict[str, Any]:
    """A record by the names of its JSON line."""
    point, sample = record.point, record.sample
    known: dict[str, Any] = dict.fromkeys(FIELDS)
    known["v"] = 1
    known["time"] = utc(time_ns)
    if record.address is not None and line is not None:
        known["device"] = line.device(record.address)
    known["kind"] = record.kind
    if point is not None:
        known["point"], known["name"], known["unit"] = point.text, point.name, point.unit
    if point is not None and sample is not None:
        known["value"] = jsonable(point.physical(sample.value))
        known["type"] = sample.type
        known["raw"] = point.raw_text(sample.raw)
    elif record.raw is not None:
        known["raw"] = record.raw.hex()
    known["fault"] = record.fault
    if record.ms is not None and record.answer_ms is not None:
        known["ms"], known["answer_ms"] = round(record.ms, 3), round(record.answer_ms, 3)
    if record.error is not None:
        known["error"] = record.error
    else:
        del known["error"]
    known["text"] = record.text
    return known


def local(time_ns: int) -> str:
    """For people: local time with milliseconds."""
    clock = datetime.fromtimestamp(time_ns // 10**9)
    return f"{clock:%Y-%m-%d %H:%M:%S}.{time_ns // 10**6 % 1000:03d}"


class Shown:
    """Shows what was found, as far as it is wanted: lines with their ends, or nothing."""

    HEAD = ""
    """What stands before everything else."""

    def __init__(self, wanted: Filter, wall: WallTime) -> None:
        self._wanted = wanted
        self._all = wanted == Filter()
        self._wall = wall

    def __call__(self, found: Found, line: Listened | None) -> str:
        return "".join(
            self.record(record, line, self._wall(record.at))
            for record in records(found)
            if self._all or self._wanted.passes(record, line)
        )

    def record(self, record: Record, line: Listened | None, time_ns: int) -> str:
        raise NotImplementedError


class JsonLines(Shown):
    """`fields` as JSON; what is the same for every sample of a point is put together once."""

    MOST = 4096  # points that are remembered

    def __init__(self, wanted: Filter, wall: WallTime) -> None:
        super().__init__(wanted, wall)
        self._known: dict[tuple[Any, ...], _Fixed] = {}

    def record(self, record: Record, line: Listened | None, time_ns: int) -> str:
        _, address, kind, point, sample, _, fault, ms, answer_ms, error, text = record
        if sample is None or ms is None or answer_ms is None or error is not None:
            return _json(fields(record, line, time_ns)) + "\n"
        key = (id(line), id(point), address, kind, sample.type)
        fixed = self._known.get(key)
        if fixed is None:
            fixed = self._remember(key, record, line)
        value = sample.value
        if fixed.scaled or type(value) is not int:
            value = _json(jsonable(fixed.point.physical(value)))
        raw = fixed.point.raw_text(sample.raw)
        return (
            f'{{"v": 1, "time": "{utc(time_ns)}{fixed.before_value}{value}{fixed.before_raw}{raw}", '
            f'"fault": {_LITERALS[fault]}, "ms": {round(ms, 3)}, "answer_ms": {round(answer_ms, 3)}, '
            f'"text": {_quoted(text)}}}\n'
        )

    def _remember(self, key: tuple[Any, ...], record: Record, line: Listened | None) -> _Fixed:
        known = fields(record, line, 0)
        before_value = {name: known[name] for name in ("device", "kind", "point", "name")}
        before_raw = {name: known[name] for name in ("unit", "type")}
        assert record.point is not None
        description = record.point.description
        fixed = _Fixed(
            f'", {_json(before_value)[1:-1]}, "value": ',
            f', {_json(before_raw)[1:-1]}, "raw": "',
            record.point,
            line,
            description is not None and description.scale != 1.0,
        )
        if len(self._known) == self.MOST:
            self._known.clear()
        self._known[key] = fixed
        return fixed


class _Fixed(NamedTuple):
    """What is the same for every sample of a point. It keeps point and line: their ids are its key."""

    before_value: str
    before_raw: str
    point: Point
    line: Listened | None
    scaled: bool


_LITERALS = {None: "null", True: "true", False: "false"}


class Csv(Shown):
    """What is not known is empty; of an error there is the kind."""

    FIELDS = FIELDS[1:]
    HEAD = ",".join(FIELDS) + "\n"

    def record(self, record: Record, line: Listened | None, time_ns: int) -> str:
        known = fields(record, line, time_ns)
        if "error" in known:
            known["error"] = known["error"]["kind"]
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerow([known.get(name) for name in self.FIELDS])
        return out.getvalue()


class Text(Shown):
    """A line for each transaction, for a person."""

    def __call__(self, found: Found, line: Listened | None) -> str:
        known = list(records(found))
        if not (self._all or any(self._wanted.passes(record, line) for record in known)):
            return ""
        return f"{local(self._wall(known[0].at))}  {_said(found, line)}\n"


def _said(found: Found, line: Listened | None) -> str:
    if isinstance(found, Damage):
        raw = found.raw[:24].hex(" ").upper() + (" ..." if len(found.raw) > 24 else "")
        return f"! {raw}  {found.reason}"
    assert line is not None, "without a protocol there are no frames"
    if isinstance(found, Stray):
        return f"? {line.label(found.heard.frame.address):<14} {found.text}  (not asked for)"
    ms = "" if found.answer_ms is None else f"  ({found.answer_ms:.1f} ms)"
    return f"  {line.label(found.address):<14} {found.meaning.text}{ms}"


STYLES: dict[str, type[Shown]] = {"json": JsonLines, "csv": Csv, "text": Text}
