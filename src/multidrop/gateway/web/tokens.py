"""Tokens: who may read and who may write over HTTP. The file has their hashes, never themselves.

::

    [control-room]
    sha256 = "9f86d081884c7d65..."
    rights = ["read", "write"]
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from multidrop.errors import UsageError
from multidrop.toml_values import read_toml

PREFIX = "mdt_"
"""Begins every token, so that one that was left somewhere is recognised."""

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


class Right(StrEnum):
    """What a request needs. One does not include the other."""

    READ = "read"
    WRITE = "write"


@dataclass(frozen=True, slots=True)
class Token:
    """Somebody who may do something. `name` stands in the audit log."""

    name: str
    sha256: str
    rights: frozenset[Right]


def digest(secret: str) -> str:
    """A token has 256 bits of chance, so a plain hash cannot be turned round."""
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()


def read_tokens(path: Path) -> tuple[Token, ...]:
    """The tokens of a file. Raises `UsageError` that names file, key and reason."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not UTF-8 text") from None
    entries = read_toml(text, str(path)).items()
    return tuple(_token(name, entry, f"{path}: {name}") for name, entry in entries)


def _token(name: str, entry: Any, where: str) -> Token:
    if not isinstance(entry, dict) or set(entry) != {"sha256", "rights"}:
        raise UsageError(f"{where} is not a table with sha256 and rights")
    sha256, rights = entry["sha256"], entry["rights"]
    if not isinstance(sha256, str) or not re.fullmatch(r"[0-9a-f]{64}", sha256):
        raise UsageError(
            f"{where}.sha256 is not 64 hexadecimal digits: make it with multidrop token"
        )
    if not isinstance(rights, list) or not rights or not set(rights) <= set(Right):
        raise UsageError(f"{where}.rights is not a list of: {', '.join(Right)}")
    return Token(name, sha256, frozenset(Right(right) for right in rights))


def make_token(path: Path, name: str, rights: Sequence[Right]) -> str:
    """Add a token to a file, which only its owner can read; returns the token, once.

    Raises `UsageError` for a name that is taken or is none.
    """
    if not NAME.fullmatch(name):
        raise UsageError(f"{name!r} is no name for a token: letters, digits, _ and -")
    if path.exists() and any(token.name == name for token in read_tokens(path)):
        raise UsageError(f"{path} has a token {name!r} already: take its table out first")
    secret = PREFIX + secrets.token_urlsafe(32)
    listed = ", ".join(f'"{right}"' for right in rights)
    entry = f'[{name}]\nsha256 = "{digest(secret)}"\nrights = [{listed}]\n\n'
    try:
        with os.fdopen(os.open(path, os.O_CREAT | os.O_APPEND | os.O_WRONLY, 0o600), "a") as file:
            file.write(entry)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    return secret


class TokenFile:
    """The tokens of a file as it is now: a table that was taken out counts no longer at once."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._stamp: tuple[int, int] | None = None
        self._tokens: tuple[Token, ...] = ()

    def all(self) -> tuple[Token, ...]:
        """Raises `UsageError` where the file is away or wrong."""
        if self._path is None:
            return ()
        try:
            found = self._path.stat()
        except OSError as error:
            raise UsageError(f"{self._path}: {error.strerror}") from None
        stamp = (found.st_mtime_ns, found.st_size)
        if stamp != self._stamp:
            self._tokens = read_tokens(self._path)
            self._stamp = stamp
        return self._tokens

    def find(self, secret: str) -> Token | None:
        """Whose token this is."""
        given = digest(secret)
        found = [token for token in self.all() if secrets.compare_digest(token.sha256, given)]
        return found[0] if found else None
