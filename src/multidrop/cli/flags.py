"""Options that several commands have, with one meaning and one help."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import click

from multidrop.catalog import CONFIG
from multidrop.naming import LINE_KEYS

as_json = click.option("--json", is_flag=True, help="JSON Lines on standard output")
trace = click.option("--trace", is_flag=True, help="every frame, decoded, on standard error")
capture = click.option(
    "--capture", metavar="FILE", help="the traffic of this command, as pcapng for Wireshark"
)
config = click.option("--config", metavar="FILE", help=f"the plant file, instead of ./{CONFIG}")

OWN_KEYS = {  # of protocols; refused where they do not exist
    "broadcast": "broadcast address (slink3, ultra3000)",
    "stuffing": "on or off: byte stuffing (datalink)",
    "settle": "s that an instrument has to show a change (datalink)",
}
KEYS = {**LINE_KEYS, **OWN_KEYS}
"""The keys of a line, and what they mean."""


def line_keys(command: Any, keys: Iterable[str] = KEYS) -> Any:
    """Gives a command these keys as options."""
    for key in reversed(list(keys)):
        command = click.option(f"--{key}", f"key_{key}", metavar="X", help=KEYS[key])(command)
    return command


def taken_keys(given: dict[str, Any]) -> dict[str, str]:
    """Takes those keys out of the options that were given; what was not given is left away."""
    taken = {key: given.pop(f"key_{key}", None) for key in KEYS}
    return {key: str(text) for key, text in taken.items() if text is not None}
