"""A PostgreSQL server: the one that is there, else one of our own from the system's packages."""

from __future__ import annotations

import contextlib
import os
import pwd
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

DSN = os.environ.get("MULTIDROP_POSTGRES", "postgresql://postgres@127.0.0.1:5432/test")
PACKAGED = Path("/usr/lib/postgresql")
"""Where Debian has the programs of each version."""

STARTED_WITHIN = 30.0  # s
OWNER = "postgres"
"""Whom the server runs as where we are root, which it refuses to be."""


@contextlib.contextmanager
def server() -> Iterator[str | None]:
    """Its DSN; None where there is none and none can be started, which is said."""
    reason = _reason(DSN)
    programs = _programs()
    if reason is None:
        yield DSN
    elif programs is None or "psycopg" in reason:
        print(f"PostgreSQL is not measured: {reason}; no server to start")
        yield None
    else:
        with _own(programs) as dsn:
            yield dsn


def _reason(dsn: str) -> str | None:
    """Why a server cannot be used; None where it can."""
    try:
        import psycopg
    except ImportError:
        return "psycopg is not installed"
    try:
        psycopg.connect(dsn, connect_timeout=3).close()
    except psycopg.OperationalError as error:
        return str(error).strip()
    return None


def _programs() -> Path | None:
    """The folder of initdb and postgres; None where they are not installed."""
    found = shutil.which("initdb")
    packaged = sorted(PACKAGED.glob("*/bin/initdb"), key=lambda path: float(path.parts[-3]))
    return Path(found).parent if found else packaged[-1].parent if packaged else None


@contextlib.contextmanager
def _own(programs: Path) -> Iterator[str]:
    """A server with a database of its own, as it is installed, on a free port."""
    owner = OWNER if os.geteuid() == 0 else None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if owner is not None:
            os.chown(folder, pwd.getpwnam(owner).pw_uid, -1)
        data = folder / "data"
        subprocess.run(
            [programs / "initdb", "-D", data, "-U", "postgres", "-A", "trust"],
            check=True,
            user=owner,
            cwd=folder,
            stdout=subprocess.DEVNULL,
        )
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        process = subprocess.Popen(
            [programs / "postgres", "-D", data, "-p", str(port), "-k", folder],
            user=owner,
            cwd=folder,
            stderr=subprocess.DEVNULL,
        )
        dsn = f"postgresql://postgres@127.0.0.1:{port}/postgres"
        try:
            until = time.monotonic() + STARTED_WITHIN
            while (reason := _reason(dsn)) is not None:
                if time.monotonic() > until:
                    raise RuntimeError(f"the server does not start: {reason}")
                time.sleep(0.1)
            yield dsn
        finally:
            process.terminate()
            process.wait()
