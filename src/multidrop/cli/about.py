"""`multidrop ports`, `points`: what is there and what is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from multidrop.catalog import load_profile
from multidrop.cli.flags import as_json
from multidrop.cli.words import json_line
from multidrop.profile import PointDescription

PLAIN_WIDTH = 240
"""Columns of a table that goes into a file or a pipe."""

GAP = 3
"""Characters between two columns."""


@click.command(epilog="Example: multidrop ports")
@as_json
def ports(json: bool) -> None:
    """List the serial ports of this machine: stable name, adapter, busy or not, latency."""
    from multidrop.io.list_ports import list_ports

    found = list_ports()
    if json:
        for facts in found:
            click.echo(json_line(facts.fields()))
        return
    if not found:
        click.echo("no serial ports on this machine; a device server is tcp://HOST:PORT", err=True)
    rows = [
        (
            facts.port,
            facts.adapter,
            facts.problem or (f"busy: {facts.busy}" if facts.busy else "free"),
            "" if facts.latency_ms is None else f"{facts.latency_ms} ms",
        )
        for facts in found
    ]
    print_table(("port", "adapter", "state", "latency"), rows)
    if any((facts.latency_ms or 0) > 1 for facts in found):
        click.echo("a latency of 1 ms makes reads faster: docs, howto/wiring", err=True)


@click.command(epilog="Example: multidrop points flexmax speed")
@click.argument("profile")
@click.argument("word", required=False)
@as_json
def points(profile: str, word: str | None, json: bool) -> None:
    """List the points of PROFILE, or those that WORD occurs in."""
    found = load_profile(profile)
    chosen = [item for item in found.points.values() if word is None or _mentions(item, word)]
    if json:
        for item in chosen:
            click.echo(json_line({"profile": found.name, **_facts(item)}))
        return
    rows = [
        (
            item.name,
            item.at,
            item.role.value,
            item.access,
            _limits(item),
            item.unit or "",
            item.meaning,
        )
        for item in chosen
    ]
    if not rows:
        why = (
            f"no point of {found.name} mentions {word!r}" if word else f"{found.name} has no points"
        )
        click.echo(f"{why}; any point can be named by its number", err=True)
        return
    print_table(("name", "point", "role", "", "limits", "unit", "meaning"), rows)


def _mentions(item: PointDescription, word: str) -> bool:
    return any(word.lower() in text.lower() for text in (item.name, item.at, item.meaning))


def _facts(item: PointDescription) -> dict[str, Any]:
    return {
        "name": item.name,
        "point": item.at,
        "role": item.role.value,
        "access": item.access,
        "unit": item.unit,
        "scale": item.scale,
        "minimum": item.minimum,
        "maximum": item.maximum,
        "default": item.default,
        "meaning": item.meaning,
        "source": item.source,
    }


def _limits(item: PointDescription) -> str:
    if item.minimum is None and item.maximum is None:
        return ""
    low = "" if item.minimum is None else f"{item.minimum:.10g}"
    high = "" if item.maximum is None else f"{item.maximum:.10g}"
    return f"{low}..{high}"


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table whose columns fold between words, plain when it goes into a file.

    Where a terminal has no room for whole words, each row is two lines: a name
    that is folded cannot be typed.
    """
    from rich import box
    from rich.cells import cell_len
    from rich.console import Console
    from rich.table import Table

    if not rows:
        return
    columns = list(zip(heads, *rows, strict=True))
    words = [
        max(cell_len(word) for cell in column for word in cell.split(" ")) for column in columns
    ]
    console = Console()
    room = console.width if console.is_terminal else PLAIN_WIDTH
    if sum(words) + GAP * len(words) > room:
        for first, second, *others in rows:
            click.echo(f"{first}   {second}\n    {'   '.join(filter(None, others))}".rstrip())
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head, *cells in columns:
        table.add_column(head, overflow="fold", no_wrap=not any(" " in cell for cell in cells))
    for row in rows:
        table.add_row(*row)
    console.width = room
    console.print(table)
