"""A press: a FlexMax with settings of its own, for tests of passports."""

from __future__ import annotations

HEAD = """
[profile]
name = "press"
version = "3"
protocol = "slink3"
dialect = "flexmax"
[points]
address = { at = "8511:uint16", role = "communication" }
control_word = { at = "std/0x6040.0:uint16", role = "command" }
"""


def press(*points: str) -> str:
    """Its profile, with these points too."""
    return HEAD + "\n".join([*points, ""])
