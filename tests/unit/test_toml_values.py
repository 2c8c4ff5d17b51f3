"""Values as TOML: whatever is written in one line is read again as it was."""

from __future__ import annotations

import tomllib
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from multidrop.toml_values import toml_key, toml_table, toml_value

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
PLAIN = st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | TEXT
VALUES = st.recursive(
    PLAIN,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=8,
)


@given(TEXT, VALUES)
def test_what_is_written_is_read_again(key: str, value: Any) -> None:
    line = f"{toml_key(key)} = {toml_value(value)}"
    assert "\n" not in line
    assert tomllib.loads(line) == {key: value}


def test_how_they_look() -> None:
    table = {"on": True, "off": False, "raw": b"\x01\xff", "two words": (1, 2.5), "none": {}}
    assert toml_table(table) == (
        '{ on = true, off = false, raw = "01ff", "two words" = [1, 2.5], none = {} }'
    )
    assert toml_value("\x7f\n") == r'"\u007f\n"'
