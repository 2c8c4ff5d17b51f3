"""What an option takes for a number: the digits 0 to 9 alone, as everywhere where one is typed."""

from __future__ import annotations

from typing import Any

import click

from multidrop.numerals import plain


class _Plain(click.ParamType):  # type: ignore[type-arg]  # older ones take none
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str):
            try:
                plain(value)
            except ValueError:
                self.fail(f"{value!r} is not a valid {self.name}.", param, ctx)
        return super().convert(value, param, ctx)


class Whole(_Plain, click.types.IntParamType):
    """A whole number."""


class WholeFrom(_Plain, click.IntRange):
    """A whole number in a range."""


class Number(_Plain, click.types.FloatParamType):
    """A number with or without a fraction."""


class NumberFrom(_Plain, click.FloatRange):
    """A number in a range."""
