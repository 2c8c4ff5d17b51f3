"""Values as TOML: whatever is written in one line is read again as it was."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.errors import UsageError
from multidrop.toml_values import read_toml, toml_key, toml_table, toml_value

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


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a = [", r"f.toml: not TOML: .*at end of document"),
        ("a = " + "9" * 5000, r"f.toml: not TOML: Exceeds the limit .* digits"),
        ("a = " + "[" * 100_000, "f.toml: not TOML: it is nested too deeply"),
    ],
)
def test_what_cannot_be_read_has_a_reason(text: str, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        read_toml(text, "f.toml")
    assert read_toml("a = 1", "f.toml") == {"a": 1}
