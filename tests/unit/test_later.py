"""Attributes that are imported at their first use."""

from __future__ import annotations

import sys

from multidrop.later import Later


class House:
    parse = Later("fractions", "Fraction")
    nothing = Later("string", "digits")

    def door(self) -> str:
        return "open"


def test_a_room_is_entered_once_and_stays() -> None:
    assert House().parse("1/2") == 0.5
    assert House().parse is sys.modules["fractions"].Fraction
    assert isinstance(vars(House)["parse"], staticmethod), "the next use costs no import"


def test_what_is_no_function_is_found_too() -> None:
    assert House().nothing == House.nothing == "0123456789"


def test_a_command_that_reads_enters_no_room_that_it_does_not_need() -> None:
    import subprocess

    unneeded = ["broadcast", "explain", "probe", "relay", "sweep", "describe"]
    program = (
        "import sys; from multidrop.io.connection import Target; "
        "Target.of('flexmax:0@x').device(); print(*sys.modules)"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "multidrop.protocols.slink3.device" in loaded
    assert [name for name in unneeded if f"multidrop.protocols.slink3.{name}" in loaded] == []
