"""How what waits in the outbox comes to the server: how often, how soon, and what is in the way."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from postgres import own_schema, postgres_dsn

from multidrop.gateway.history.batching import Batching
from multidrop.gateway.history.records import Batch
from multidrop.gateway.outbox import Outbox, Waiting
from unit.gateway.history.stores import START, sample

pytest.importorskip("psycopg")

from multidrop.gateway.history.packing import pack
from multidrop.gateway.history.postgres import PostgresStore
from multidrop.gateway.history.postgres_sending import AT_ONCE

END = START + 10**15
SENDING = "multidrop.gateway.history.postgres_sending"
PATIENCE = 20.0  # s


@pytest.fixture
def schema() -> Iterator[str]:
    postgres_dsn()
    with own_schema() as name:
        yield name


@pytest.fixture
def unsealed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples stay where the transaction that brought them can be seen."""
    monkeypatch.setattr(f"{SENDING}.SEAL_ONE", 10**9)
    monkeypatch.setattr(f"{SENDING}.SEAL_ALL", 10**9)


def many(count: int, samples: int = 1) -> list[Batch]:
    batching = Batching("run", most=10_000_000)
    for number in range(count):
        first = number * samples
        batching.take(sample(second, second) for second in range(first, first + samples))
        batching.cut(1000.0 + first + samples)
    return batching.cut(float("inf"))


def opened(folder: Path, schema: str, every: float, options: str = "") -> PostgresStore:
    from psycopg.conninfo import make_conninfo

    outbox = Outbox(folder / "outbox.db", 10**9)
    dsn = make_conninfo(postgres_dsn(), options=options)
    return PostgresStore(dsn, outbox, schema=schema, every=every)


def until(what: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < end
        time.sleep(0.005)


def commits(schema: str) -> int:
    """Transactions that brought samples, as the server numbers them."""
    import psycopg

    with psycopg.connect(postgres_dsn()) as connection:
        query = f"SELECT count(DISTINCT xmin::text) FROM {schema}.recent"
        row = connection.execute(query.encode()).fetchone()
    assert row is not None
    return int(row[0])


def values(store: PostgresStore) -> list[object]:
    return [one.value for one in store.range("infeed", "speed", START, END)]


@pytest.mark.usefixtures("unsealed")
def test_the_server_commits_once_in_a_while_however_often_is_written(
    tmp_path: Path, schema: str
) -> None:
    store = opened(tmp_path, schema, 0.3)
    began = time.monotonic()
    for batch in many(60):
        store.write([batch])
        time.sleep(0.02)
    until(lambda: store.delivered)
    assert 2 <= commits(schema) <= 1 + (time.monotonic() - began) / 0.3
    assert values(store) == list(range(60))
    store.close()


@pytest.mark.usefixtures("unsealed")
def test_what_waits_in_great_numbers_goes_in_few_commits_and_soon(
    tmp_path: Path, schema: str
) -> None:
    store = opened(tmp_path, schema, 1.0)
    began = time.monotonic()
    store.write(many(500, 40))
    until(lambda: store.delivered)
    took = time.monotonic() - began
    assert commits(schema) <= 1 + took
    assert commits(schema) < 500 / AT_ONCE  # no lot waits for its own
    assert values(store) == list(range(20_000))
    store.close()


def test_what_comes_after_a_rest_does_not_wait(tmp_path: Path, schema: str) -> None:
    store = opened(tmp_path, schema, 30.0)
    until(lambda: store.state.error is None)
    store.write(many(1))
    until(lambda: store.delivered)
    began = time.monotonic()
    store.close()  # and neither does who closes
    assert time.monotonic() - began < 5.0


def test_a_store_closes_in_time_however_much_waits(
    tmp_path: Path, schema: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"{SENDING}.LAST_WITHIN", 0.05)
    store = opened(tmp_path, schema, 0.01)
    store.write(many(500, 100))
    began = time.monotonic()
    store.close()
    assert time.monotonic() - began < 5.0
    again = opened(tmp_path, schema, 0.01)
    assert again.state.waiting > 0
    until(lambda: again.delivered)
    assert values(again) == list(range(50_000))
    again.close()


def test_an_outbox_that_cannot_be_read_for_a_while_is_told(
    tmp_path: Path, schema: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"{SENDING}.RETRY", 0.01)

    def broken(_: Outbox, most: int, after: int) -> list[Waiting]:
        raise sqlite3.OperationalError("disk I/O error")

    store = opened(tmp_path, schema, 0.01)
    with monkeypatch.context() as patched:
        patched.setattr(Outbox, "take", broken)
        store.write(many(3))
        until(lambda: store.state.error == "disk I/O error")
    until(lambda: store.delivered)
    until(lambda: store.state.error is None)
    assert values(store) == [0, 1, 2]
    store.close()


def test_what_is_damaged_in_the_outbox_is_told_and_stays(tmp_path: Path, schema: str) -> None:
    outbox = Outbox(tmp_path / "outbox.db", 10**9)
    good, other = many(2)
    outbox.put([(pack(good), 0, 0, 1), (b"\x00\x01", 0, 0, 1), (pack(other), 0, 0, 1)])
    outbox.close()
    store = opened(tmp_path, schema, 0.01)
    until(lambda: store.state.error)
    assert "outbox.db: what waits in it is damaged" in str(store.state.error)
    assert store.state.waiting == 2
    assert values(store) == [0]
    store.close()


def test_blocks_are_in_order_on_a_server_with_little_memory(tmp_path: Path, schema: str) -> None:
    """It sorts on its disk then, and leaves equals in any order."""
    store = opened(tmp_path, schema, 0.01, "-c work_mem=64kB")
    store.write(many(1, 30_000))
    until(lambda: store.delivered)
    assert values(store) == list(range(30_000))
    store.close()


def test_who_asks_which_points_there_are_sees_later_what_came_later(
    tmp_path: Path, schema: str
) -> None:
    store = opened(tmp_path, schema, 0.01)
    first, second = many(2)
    store.write([first])
    until(lambda: store.delivered)
    assert store.series() == [("infeed", "speed")]
    store.write([second])
    until(lambda: store.delivered)
    assert values(store) == [0, 1]
    store.close()
