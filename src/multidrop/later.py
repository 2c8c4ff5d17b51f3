"""Rooms that are entered when they are first needed, so that a command that only reads starts fast."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Later:
    """An attribute of a class that stands in a module of its own, imported at its first use.

    A function is found as it is: what calls it passes no `self`.
    """

    def __init__(self, module: str, name: str) -> None:
        self._module = module
        self._name = name

    def __set_name__(self, owner: type, attribute: str) -> None:
        self._attribute = attribute

    def __get__(self, instance: object, owner: type) -> Any:
        found = getattr(import_module(self._module), self._name)
        setattr(owner, self._attribute, staticmethod(found) if callable(found) else found)
        return found
