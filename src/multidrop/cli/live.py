"""A table that lives: values with their trend in a terminal, plain lines elsewhere."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from math import isfinite
from types import TracebackType
from typing import Any, Self

import click

from multidrop.cli.words import with_unit
from multidrop.points import Value

BARS = "▁▂▃▄▅▆▇█"
TREND = 40  # values
VALUE = 14  # characters at least
GAPS = 11  # characters between the columns
NOTE = 20  # characters that a note has at least
SHORT = 8  # values; a shorter trend tells nothing


def sparkline(values: Sequence[float], width: int = TREND) -> str:
    """The last `width` values as bars between the lowest and the highest of them."""
    shown = list(values)[-width:]
    if not shown:
        return ""
    low, high = min(shown) / 2, max(shown) / 2  # halves: the span of the largest floats overflows
    span = high - low
    if not span:
        return BARS[0] * len(shown)
    return "".join(BARS[round((value / 2 - low) / span * (len(BARS) - 1))] for value in shown)


@dataclass
class Row:
    """One point of the table: its latest value or failure, and its trend."""

    label: str
    unit: str
    value: Value | None = None
    note: str = ""
    bad: bool = False
    trend: deque[float] = field(default_factory=lambda: deque(maxlen=TREND))

    def show(self, value: Value, note: str = "", *, bad: bool = False) -> bool:
        """A new value; returns whether anything changed that a person would see."""
        before = self.text, self.note, self.bad
        self.value, self.note, self.bad = value, note, bad
        if isinstance(value, int | float) and isfinite(value):
            self.trend.append(float(value))
        return before != (self.text, note, bad)

    def fail(self, why: str) -> bool:
        """The value could not be read: the old one is not shown as if it were true."""
        changed = (why, True) != (self.note, self.bad)
        self.value, self.note, self.bad = None, why, True
        return changed

    @property
    def text(self) -> str:
        if self.value is None:
            return "-"
        return with_unit(self.value, self.unit)


class LiveTable:
    """Shows rows in place where standard output is a terminal; else prints each change."""

    def __init__(self, title: str, rows: Sequence[Row]) -> None:
        self._title = title
        self._rows = rows
        self._live: Any = None
        self._width = 0

    def __enter__(self) -> Self:
        from rich.console import Console
        from rich.live import Live

        console = Console()
        if console.is_terminal and not console.is_dumb_terminal:  # a dumb one cannot go back
            self._width = console.width
            self._live = Live(self._table(), console=console, auto_refresh=False)
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def changed(self, row: Row) -> None:
        """A row has something new to show."""
        if self._live is None:
            clock = datetime.now().strftime("%H:%M:%S")
            note = f"   {row.note}" if row.note else ""
            click.echo(f"{clock}   {row.label:<32} {row.text}{note}")

    def refresh(self) -> None:
        if self._live is not None:
            self._live.update(self._table(), refresh=True)

    def _room_for_trend(self) -> int:
        """What names, values and notes leave: on a narrow terminal the trend is what goes."""
        names = max(len(row.label) for row in self._rows)
        values = max(len(row.text) for row in self._rows)
        notes = min(NOTE, max(len(row.note) for row in self._rows))
        room = self._width - names - max(VALUE, values) - notes - GAPS
        return min(TREND, room) if room >= SHORT else 0

    def _table(self) -> Any:
        from rich import box
        from rich.table import Table
        from rich.text import Text

        trend = self._room_for_trend()
        table = Table(title=self._title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
        table.add_column("point", overflow="fold")
        table.add_column("value", justify="right", min_width=VALUE, no_wrap=True)
        if trend:
            table.add_column("trend", min_width=trend, no_wrap=True)
        table.add_column("", overflow="fold")
        for row in self._rows:
            style = "bold red" if row.bad else ""
            bars = [Text(sparkline(row.trend, trend), "cyan")] if trend else []
            table.add_row(Text(row.label), Text(row.text, style), *bars, Text(row.note, style))
        return table
