"""Bodies of requests: JSON objects with known keys."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from starlette.requests import ClientDisconnect, Request

from multidrop.errors import UsageError
from multidrop.profile import nearest


async def body_of(request: Request, keys: Sequence[str]) -> dict[str, Any]:
    """The body as an object. A key that nobody knows might ask for something else: refused."""
    try:
        text = (await request.body()).decode()
    except ClientDisconnect:
        raise UsageError("the body ends before its end") from None
    except UnicodeDecodeError:
        raise UsageError("the body is not UTF-8") from None
    try:
        body = json.loads(text, object_pairs_hook=_once)
    except (ValueError, RecursionError):
        raise UsageError("the body is not JSON") from None
    if not isinstance(body, dict):
        raise UsageError("the body is not a JSON object")
    for key in body:
        if key not in keys:
            raise UsageError(f"unknown key {key!r}{nearest(key, keys)}; keys are {', '.join(keys)}")
    return body


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Raises `UsageError`: which of two values is meant, nobody knows."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise UsageError("the body has a key twice")
    return found


def text_of(body: dict[str, Any], name: str) -> str:
    value = body.get(name)
    if not isinstance(value, str):
        raise UsageError(f"{name} is missing, or not a text")
    return value
