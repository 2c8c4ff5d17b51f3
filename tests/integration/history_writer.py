"""A process that records until it is killed: `python history_writer.py FOLDER FIRST [DSN SCHEMA]`.

Two points count up from FIRST, 1,000 samples a second. After each writing it prints the
number before which everything is in the store.
"""

from __future__ import annotations

import asyncio
import sys
import time
from pathlib import Path

from multidrop.gateway.history.part import History
from multidrop.gateway.history.records import Sample
from multidrop.gateway.history.sqlite import SqliteStore
from multidrop.gateway.history.store import Store

EVERY = 0.1
"""s between two writings: ten times as many chances to be killed in one as in earnest."""


def open_store(folder: Path, dsn: str = "", schema: str = "") -> Store:
    if not dsn:
        return SqliteStore(folder / "history.db")
    from multidrop.gateway.history.postgres import PostgresStore
    from multidrop.gateway.outbox import Outbox

    return PostgresStore(dsn, Outbox(folder / "outbox.db", 100_000_000), schema=schema)


async def main(store: Store, first: int) -> None:
    history = History(store, every=EVERY)
    running = asyncio.create_task(history.run())
    number = first
    fed: list[tuple[int, int]] = []
    while not running.done():
        samples = []
        for _ in range(5):
            for point in ("a", "b"):
                now = time.monotonic()
                samples.append(Sample("d", point, time.time_ns() // 1000, now, True, number))
            number += 1
        history.append(samples)
        fed.append((history.recorded, number))
        while fed and fed[0][0] <= history.written:
            print(fed.pop(0)[1], flush=True)
        await asyncio.sleep(0.01)
    running.result()


if __name__ == "__main__":
    folder, first, *server = sys.argv[1:]
    asyncio.run(main(open_store(Path(folder), *server), int(first)))
