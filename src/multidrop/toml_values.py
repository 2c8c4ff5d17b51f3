"""Values as TOML writes them, each in one line."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+").fullmatch


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
