"""docs/outputs.py: what differs from run to run, and what may not."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

OUTPUTS = Path(__file__).resolve().parents[2] / "docs" / "outputs.py"
SHOWN = """06:40:53.795     +2.8 ms < 01 02  | 2 #0 OK 1009:int16 = 125
ipa_1009 (1009)                             125   int16    7D00               2.8 ms
"""


@pytest.mark.parametrize(
    ("said", "same"),
    [
        (
            SHOWN.replace("53.795     +2.8", "54.001  +1002.8").replace("   2.8 ms", "1002.8 ms"),
            True,
        ),
        (SHOWN.replace("125   int16", "126   int16"), False),
        (SHOWN.replace("01 02", "01 03"), False),
    ],
)
def test_only_times_may_differ(said: str, same: bool) -> None:
    """However long they are."""
    spec = importlib.util.spec_from_file_location("outputs", OUTPUTS)
    assert spec is not None
    assert spec.loader is not None
    outputs = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(outputs)
    assert said != SHOWN
    assert (outputs._kept(SHOWN, said) == SHOWN) == same
