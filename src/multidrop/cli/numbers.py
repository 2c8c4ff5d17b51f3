"""What an option takes for a number: the digits 0 to 9 alone, as everywhere where one is typed."""

from __future__ import annotations

from math import isfinite
from typing import Any

import click

from multidrop.numerals import plain

YEAR = 365 * 86400.0
"""s; no command waits longer for anything, and the system's clocks take it."""


class _Plain(click.ParamType):  # type: ignore[type-arg]  # older ones take none
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str):
            try:
                plain(value)
            except ValueError:
                self._refuse(value, param, ctx)
        number = super().convert(value, param, ctx)
        if isinstance(number, float) and not isfinite(number):
            self._refuse(value, param, ctx)
        return number

    def _refuse(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> None:
        self.fail(f"{value!r} is not a valid {self.name}.", param, ctx)


class Whole(_Plain, click.types.IntParamType):
    """A whole number."""


class WholeFrom(_Plain, click.IntRange):
    """A whole number in a range."""


class Number(_Plain, click.types.FloatParamType):
    """A number with or without a fraction, and no infinite one."""


class Seconds(_Plain, click.FloatRange):
    """A time of 0 s to a year."""

    def __init__(self) -> None:
        super().__init__(0.0, YEAR)
