"""Both stores, for tests that ask the same of them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from postgres import own_schema, postgres_dsn

from multidrop.gateway.history.batching import Batching
from multidrop.gateway.history.records import Batch, Kept, Sample
from multidrop.gateway.history.sqlite import SqliteStore
from multidrop.gateway.history.store import Store
from multidrop.io.poller import Quality

START = 1_790_000_000_000_000
SECOND = 1_000_000
KINDS = ("sqlite", "postgres")


class KeptStore:
    """A store that can be opened again, and what is written to it is there when `write` returns."""

    def __init__(self, kind: str, folder: Path, schema: str = "") -> None:
        self.kind = kind
        self._folder = folder
        self._schema = schema
        self.store = self.open()

    def open(self) -> Store:
        if self.kind == "sqlite":
            return SqliteStore(self._folder / "history.db")
        from multidrop.gateway.history.postgres import PostgresStore
        from multidrop.gateway.outbox import Outbox

        outbox = Outbox(self._folder / "outbox.db", 100_000_000)
        return PostgresStore(postgres_dsn(), outbox, schema=self._schema, every=0.01)

    def again(self) -> Store:
        self.store.close()
        self.store = self.open()
        return self.store

    def write(self, batches: Sequence[Batch], forget: int | None = None) -> None:
        self.store.write(batches, forget)
        if self.kind == "postgres":
            self.delivered()

    def delivered(self) -> None:
        """Wait until the server has everything."""
        from multidrop.gateway.history.postgres import PostgresStore

        assert isinstance(self.store, PostgresStore)
        until = time.monotonic() + 10
        while not self.store.delivered:
            assert time.monotonic() < until, self.store.state
            time.sleep(0.005)


@contextmanager
def kept_store(kind: str, folder: Path) -> Iterator[KeptStore]:
    if kind == "sqlite":
        found = KeptStore(kind, folder)
        yield found
        found.store.close()
        return
    postgres_dsn()
    with own_schema() as schema:
        found = KeptStore(kind, folder, schema)
        yield found
        found.store.close()


def sample(
    second: float,
    value: Kept,
    *,
    point: str = "speed",
    quality: Quality = Quality.GOOD,
    step: float = 0.0,
    synchronised: bool | None = True,
) -> Sample:
    """Of `second` s after the start; `step`: by how many s wall time has stepped."""
    time = START + round((second + step) * SECOND)
    return Sample("infeed", point, time, 1000.0 + second, synchronised, value, quality)


def batches(samples: Sequence[Sample], *, run: str = "run", stop: bool = False) -> list[Batch]:
    """All of them at once."""
    batching = Batching(run, most=10_000_000)
    batching.take(samples)
    return batching.cut(samples[-1].monotonic, stop=stop)
