"""A real PostgreSQL. Without one a test is skipped."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

import pytest

DSN = os.environ.get("MULTIDROP_POSTGRES", "postgresql://postgres@127.0.0.1:5432/test")


def postgres_dsn() -> str:
    """Where the server is. Skips the test if there is none."""
    try:
        import psycopg
    except ImportError:
        pytest.skip("psycopg is not installed (multidrop[postgres])")
    try:
        psycopg.connect(DSN, connect_timeout=3).close()
    except psycopg.OperationalError as error:
        pytest.skip(f"no PostgreSQL answers at {DSN}: {error}")
    return DSN


@contextmanager
def own_schema() -> Iterator[str]:
    """A schema that nobody else uses, gone afterwards."""
    import psycopg
    from psycopg import sql

    name = f"multidrop_{uuid.uuid4().hex[:12]}"
    try:
        yield name
    finally:
        with psycopg.connect(DSN, autocommit=True) as connection:
            drop = sql.SQL("DROP SCHEMA IF EXISTS {} CASCADE")
            connection.execute(drop.format(sql.Identifier(name)))


@contextmanager
def own_database() -> Iterator[str]:
    """The DSN of a database that nobody else uses, gone afterwards."""
    parts = urlsplit(postgres_dsn())
    import psycopg
    from psycopg import sql

    name = f"multidrop_{uuid.uuid4().hex[:12]}"
    named = sql.Identifier(name)
    with psycopg.connect(DSN, autocommit=True) as connection:
        connection.execute(sql.SQL("CREATE DATABASE {}").format(named))
    try:
        yield parts._replace(path=f"/{name}").geturl()
    finally:
        with psycopg.connect(DSN, autocommit=True) as connection:
            connection.execute(sql.SQL("DROP DATABASE IF EXISTS {} WITH (FORCE)").format(named))
