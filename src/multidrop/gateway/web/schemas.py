"""The shapes of the OpenAPI document."""

from __future__ import annotations

from typing import Any

from multidrop.gateway.passports import State
from multidrop.gateway.web.operations import (
    ANY_VALUE,
    NUMBER,
    TEXT,
    TIME,
    WHOLE,
    YES_NO,
    Schema,
    fields,
    listed,
    maybe,
    ref,
)
from multidrop.io.poller import Quality
from multidrop.points import Role
from multidrop.writing import Outcome


def _one_of(words: Any) -> Schema:
    return {"type": "string", "enum": [word.value for word in words]}


WRITE: Schema = {
    **fields(
        device={**TEXT, "examples": ["infeed"]},
        point={**TEXT, "examples": ["feed"]},
        value={**NUMBER, "description": "physical", "examples": [12.5]},
    ),
    "additionalProperties": False,
}

SCHEMAS: dict[str, Schema] = {
    "Failure": fields(error=fields(kind=TEXT, code=maybe(WHOLE), text=TEXT)),
    "Health": fields(
        status={"type": "string", "enum": ["ok", "degraded", "failing"]},
        lines_lost=WHOLE,
        parts={
            "type": "object",
            "additionalProperties": {"type": "string", "enum": ["ok", "waiting", "failing"]},
        },
    ),
    "Plant": fields(lines=listed(ref("Line")), parts=listed(TEXT)),
    "Line": fields(name=TEXT, port=TEXT, devices=listed(ref("Device"))),
    "Device": fields(
        name=TEXT,
        line=TEXT,
        protocol=TEXT,
        profile=TEXT,
        title=TEXT,
        address=maybe(WHOLE),
        points=listed(ref("Point")),
    ),
    "Point": fields(
        name=TEXT,
        at=TEXT,
        type=maybe(TEXT),
        unit=maybe(TEXT),
        role=_one_of(Role),
        meaning=TEXT,
        every=NUMBER,
        names={"type": "object", "additionalProperties": TEXT},
        bits=listed(TEXT),
        hexadecimal=YES_NO,
        write={"anyOf": [ref("Limits"), {"type": "null"}]},
    ),
    "Limits": fields(min=NUMBER, max=NUMBER, rate=NUMBER, motion=YES_NO),
    "Status": fields(
        now=TIME,
        history=maybe(fields(error=maybe(TEXT), waiting=WHOLE, lost=WHOLE, hours=maybe(NUMBER))),
        mqtt=maybe(fields(error=maybe(TEXT), waiting=maybe(WHOLE), hours=maybe(NUMBER))),
        troubles=listed(
            fields(part=TEXT, text=TEXT, since=TIME, losing=YES_NO, hours=maybe(NUMBER))
        ),
        lines=listed(
            fields(
                name=TEXT,
                port=TEXT,
                protocol=TEXT,
                settings=TEXT,
                lost=maybe(TEXT),
                times_opened=WHOLE,
                planned=NUMBER,
                load=NUMBER,
                missed=WHOLE,
                counters={"type": "object"},
            )
        ),
        devices=listed(
            fields(
                name=TEXT,
                line=TEXT,
                profile=TEXT,
                title=TEXT,
                address=maybe(WHOLE),
                points=WHOLE,
                silent=YES_NO,
                delay=maybe(NUMBER),
                counters={"type": "object"},
            )
        ),
        readings=listed(ref("ReadingAll")),
    ),
    "Value": fields(
        device=TEXT,
        point=TEXT,
        value=ANY_VALUE,
        meaning=maybe(TEXT),
        quality=_one_of(Quality),
        fault=maybe(YES_NO),
        time=maybe(TIME),
        checked=TIME,
        error=maybe(TEXT),
    ),
    "PointName": {
        **fields(device={**TEXT, "examples": ["infeed"]}, point={**TEXT, "examples": ["speed"]}),
        "additionalProperties": False,
    },
    "Reading": fields(
        device=TEXT,
        point=TEXT,
        value=ANY_VALUE,
        meaning=maybe(TEXT),
        unit=maybe(TEXT),
        type=TEXT,
        raw=TEXT,
        fault=maybe(YES_NO),
        time=TIME,
        ms=NUMBER,
    ),
    "Written": fields(
        device=TEXT,
        point=TEXT,
        old=ANY_VALUE,
        asked=ANY_VALUE,
        found=ANY_VALUE,
        outcome=_one_of(Outcome),
        time=TIME,
    ),
    "History": fields(
        time=listed({"type": "number", "description": "s since 1970"}),
        minimum=listed(maybe(NUMBER)),
        maximum=listed(maybe(NUMBER)),
        last=listed(ANY_VALUE),
        count=listed(WHOLE),
        gap=listed(YES_NO),
    ),
    "Trip": fields(
        device=TEXT,
        name=TEXT,
        time=TIME,
        cleared=maybe(TIME),
        status=maybe(TEXT),
        code=maybe(WHOLE),
    ),
    "FreezeFrame": {
        **fields(v=WHOLE, device=TEXT, time=TIME, cleared=maybe(TIME)),
        "description": "docs/reference/freeze-frame.md",
    },
    "DeviceName": {
        **fields(device={**TEXT, "examples": ["infeed"]}),
        "additionalProperties": False,
    },
    "State": fields(device=TEXT, lines=listed(TEXT), time=TIME),
    "ReadingAll": fields(
        device=TEXT,
        keep={**YES_NO, "description": "whether a passport is made of it"},
        who=maybe(TEXT),
        state=_one_of(State),
        points=WHOLE,
        done=WHOLE,
        unreadable=WHOLE,
        started=TIME,
        ended=maybe(TIME),
        name={**maybe(TEXT), "description": "of the passport"},
        error=maybe(TEXT),
    ),
    "Passport": fields(
        device=TEXT,
        name=TEXT,
        path={**TEXT, "description": "its file, from the folder of the plant file"},
        made_as={**maybe(TEXT), "description": "PROFILE:ADDRESS@PORT it was made of"},
        time=maybe(TIME),
        points=WHOLE,
        unreadable=WHOLE,
        damage=maybe(TEXT),
    ),
    "Side": fields(value=ANY_VALUE, unit=maybe(TEXT), type=maybe(TEXT), reason=maybe(TEXT)),
    "Differences": fields(
        before=ref("Compared"),
        after=ref("Compared"),
        differences=listed(
            fields(
                point=TEXT,
                name=maybe(TEXT),
                role=_one_of(Role),
                before={"anyOf": [ref("Side"), {"type": "null"}]},
                after={"anyOf": [ref("Side"), {"type": "null"}]},
            )
        ),
    ),
    "Compared": fields(name=maybe(TEXT), made_as=TEXT, time=TIME, points=WHOLE, unreadable=WHOLE),
    "Rights": fields(
        name=maybe(TEXT), rights=listed({"type": "string", "enum": ["read", "write"]})
    ),
}
