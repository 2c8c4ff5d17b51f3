"""Errors as JSON, and as words for a person."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from multidrop.cli.words import json_line
from multidrop.errors import DeviceError, Error, NoReply, OutcomeUnknown

INTERRUPTED = 130


def failure(error: Error) -> dict[str, Any]:
    """The `error` object of a JSON line."""
    facts: dict[str, Any] = {"kind": error.kind}
    if isinstance(error, DeviceError):
        facts["code"] = error.code
        facts["text"] = error.meaning
    else:
        facts["text"] = str(error)
    return facts


@contextmanager
def failure_as_line(name: str, wanted: bool, *, of: str = "device") -> Iterator[None]:
    """What fails in here is a JSON line too, where that is `wanted`: of a device or a port, not of a point."""
    try:
        yield
    except Error as error:
        if wanted:
            click.echo(json_line({of: name, "error": failure(error)}))
        raise


def report_failure(error: Error, what: str = "") -> None:
    """One or two lines for a person: what was asked, what came, what to try."""
    asked = f"{what}: " if what and not str(error).startswith(what) else ""
    click.secho(f"{asked}{error}", err=True, fg="red")
    advice = _advice(error)
    if advice:
        click.echo(f"  {advice}", err=True)


def _advice(error: Error) -> str:
    if isinstance(error, NoReply):
        if error.damaged:
            return (
                "bytes come, but damaged: check baud rate and format, A/B, termination; see --trace"
            )
        if error.heard:
            return "somebody else speaks: another master, or another device with this address; see --trace"
        return "check address, baud rate, format and wiring; --trace shows every frame"
    if isinstance(error, OutcomeUnknown):
        return "look at the device before you write again"
    return ""
