"""The streams of a command: closed ones, and those that have not every letter."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from typing import IO, Any


def prepare(arguments: Sequence[str]) -> None:
    """Make output possible whatever the command was started with.

    JSON is UTF-8, whatever the locale, and a file's name in it as it was typed. A
    letter that a text's encoding has not is written as its code.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, _nowhere(mode))
    if not isinstance(sys.stdout, io.TextIOWrapper):
        return  # somebody else's stream, a test's
    if "--json" in arguments:
        sys.stdout.reconfigure(encoding="utf-8", errors="surrogateescape")
    elif sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def _nowhere(mode: str) -> IO[Any]:
    """Takes the number of the closed stream, which the first port or file would have else."""
    number = os.open(os.devnull, os.O_RDWR)
    return open(number, mode, encoding="utf-8", closefd=False)
