"""TOML: what people write is read with a reason where it cannot be, values are written in one line."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from multidrop.errors import UsageError

_BARE = re.compile(r"[A-Za-z0-9_-]+").fullmatch


def read_toml(text: str, file: str, no: str = "not TOML") -> dict[str, Any]:
    """The table of a whole file. Raises `UsageError` that names `file` and says what it is `no`."""
    try:
        return tomllib.loads(text)
    except ValueError as error:  # also for a number of more digits than Python reads
        raise UsageError(f"{file}: {no}: {error}") from None
    except RecursionError:
        raise UsageError(f"{file}: {no}: it is nested too deeply") from None


def toml_value(value: Any) -> str:
    """A bool, number, text, bytes (in hex), list or table."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)  # nan and inf are written alike in both
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    if isinstance(value, Mapping):
        return toml_table(value)
    text = value.hex() if isinstance(value, bytes) else value
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_table(table: Mapping[str, Any]) -> str:
    """A table in one line."""
    inside = ", ".join(f"{toml_key(key)} = {toml_value(value)}" for key, value in table.items())
    return f"{{ {inside} }}" if inside else "{}"


def toml_key(key: str) -> str:
    return key if _BARE(key) else toml_value(key)
