"""The history of a gateway, from updates to what charts ask for."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

import pytest

from multidrop.errors import PortError, UsageError
from multidrop.gateway.history.part import History, open_store, sample_of
from multidrop.gateway.history.records import Batch, Sample
from multidrop.gateway.history.reporting import Rule
from multidrop.gateway.history.sqlite import SqliteStore
from multidrop.gateway.settings import HistorySettings
from multidrop.gateway.stamps import microseconds
from multidrop.io.poller import Quality
from unit.gateway.history.stores import SECOND, START, batches, sample
from unit.gateway.updates import NOON, update

END = START + 10**15
SOON = 0.01


class Full(SqliteStore):
    """A store whose disk is full for a while."""

    full = False
    writings = 0

    def write(self, batches: Sequence[Batch], forget: int | None = None) -> None:
        self.writings += 1
        if self.full:
            raise sqlite3.OperationalError("database or disk is full")
        super().write(batches, forget)


async def until(what: object) -> None:
    async with asyncio.timeout(10):
        while not what():  # type: ignore[operator]
            await asyncio.sleep(SOON)


async def stop(running: asyncio.Task[None]) -> None:
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


def values_in(path: Path, point: str = "speed") -> list[object]:
    store = SqliteStore(path, only_read=True)
    try:
        return [found.value for found in store.range("infeed", point, 0, END)]
    finally:
        store.close()


def test_an_update_becomes_a_sample_with_the_time_of_its_value() -> None:
    good = sample_of(update(value=True, at=3.0))
    assert good == Sample("infeed", "p", microseconds(NOON) + 3 * SECOND, 3.0, None, 1)
    lost = sample_of(update(quality=Quality.PORT_LOST, value=7, at=4.0))
    assert lost.value is None
    assert (lost.time, lost.quality) == (microseconds(NOON) + 4 * SECOND, Quality.PORT_LOST)


@pytest.mark.parametrize("step", [-3600.0, 3600.0])
def test_a_clock_that_steps_between_an_answer_and_its_update_moves_no_monotonic_time(
    step: float,
) -> None:
    heard = update(value=1, at=3.0)
    stepped = heard.polled._replace(time=heard.polled.time + timedelta(seconds=step))
    sample = sample_of(heard._replace(polled=stepped))
    assert (sample.time, sample.monotonic) == (microseconds(NOON) + 3 * SECOND, 3.0)


def test_what_is_worth_it_is_written_and_can_be_asked(tmp_path: Path) -> None:
    async def main() -> None:
        history = History(
            SqliteStore(tmp_path / "h.db"), lambda _, point: Rule(1.0, 5.0), every=SOON
        )
        running = asyncio.create_task(history.run())
        for second, value in enumerate([1, 1, 1.5, 2, 2, 2, 2, 2, 2]):
            history.take(update(value=value, at=float(second)))
        history.take(update(quality=Quality.NO_REPLY, at=9.0))
        await until(lambda: history.state.waiting == 0)
        start = microseconds(NOON)
        found = await history.range("infeed", "p", start, start + 60 * SECOND)
        assert [((one.time - start) // SECOND, one.value) for one in found] == [
            (0, 1),
            (2, 1.5),
            (3, 2),
            (8, 2),
            (9, None),
        ]
        assert await history.range("infeed", "p", start, start + 60 * SECOND, 2) == found[:2]
        assert await history.latest("infeed", "p") == found[-1]
        assert await history.series() == [("infeed", "p")]
        assert await history.gaps(start, start + 60 * SECOND) == []
        (bucket,) = await history.buckets("infeed", "p", start, start + 60 * SECOND, 1)
        assert (bucket.minimum, bucket.maximum, bucket.count, bucket.gap) == (1, 2, 4, True)
        with pytest.raises(UsageError, match="no history of infeed x"):
            await history.latest("infeed", "x")
        await stop(running)

    asyncio.run(main())


def test_a_point_that_is_polled_no_more_has_no_value_from_then_on(tmp_path: Path) -> None:
    """And is recorded at once when it is polled again, though its value is the same."""

    async def main() -> None:
        history = History(SqliteStore(tmp_path / "h.db"), every=SOON)
        running = asyncio.create_task(history.run())
        history.take(update(value=1, at=0.0))
        history.forget(update(quality=Quality.STALE, at=2.0))
        history.take(update(value=1, at=5.0))
        await until(lambda: history.state.waiting == 0)
        start = microseconds(NOON)
        found = await history.range("infeed", "p", start, start + 60 * SECOND)
        assert [((one.time - start) // SECOND, one.value) for one in found] == [
            (0, 1),
            (2, None),
            (5, 1),
        ]
        await stop(running)

    asyncio.run(main())


def test_what_came_last_is_written_when_the_gateway_stops(tmp_path: Path) -> None:
    async def main() -> None:
        history = History(SqliteStore(tmp_path / "h.db"), every=1000.0)
        running = asyncio.create_task(history.run())
        await asyncio.sleep(SOON)
        history.append([sample(0, 1), sample(1, 2)])
        await stop(running)

    asyncio.run(main())
    assert values_in(tmp_path / "h.db") == [1, 2]
    store = SqliteStore(tmp_path / "h.db", only_read=True)
    assert [span.ended for span in store._spans()] == ["stopped"]
    store.close()


def test_a_full_disk_costs_nothing_while_memory_lasts(tmp_path: Path) -> None:
    async def main() -> None:
        store = Full(tmp_path / "h.db")
        history = History(store, every=SOON)
        running = asyncio.create_task(history.run())
        history.append([sample(0, 0)])
        await until(lambda: history.state.waiting == 0)
        store.full = True
        for second in range(1, 5):
            history.append([sample(second, second)])
            before = store.writings
            await until(lambda before=before: store.writings > before)
        await until(lambda: history.state.error)
        assert history.state.error == "database or disk is full"
        assert history.state.waiting == 4
        store.full = False
        await until(lambda: history.state.waiting == 0)
        assert history.state.error is None
        await stop(running)

    asyncio.run(main())
    assert values_in(tmp_path / "h.db") == [0, 1, 2, 3, 4]


def test_a_disk_that_is_really_full(tmp_path: Path) -> None:
    """SQLite's own refusal: all of a batch is in the file, or nothing of it."""
    store = SqliteStore(tmp_path / "h.db")
    history = History(store)

    async def main() -> None:
        history.append(sample(second, second) for second in range(100))
        await history._write(0.0)
        (pages,) = store._writer.execute("PRAGMA page_count").fetchone()
        store._writer.execute(f"PRAGMA max_page_count = {pages}")
        history.append(sample(second, f"{second} {'x' * 100}") for second in range(100, 200))
        await history._write(0.0)
        assert history.state.error == "database or disk is full"
        assert len(values_in(tmp_path / "h.db")) == 100
        store._writer.execute("PRAGMA max_page_count = 100000")
        await history._write(0.0)
        assert history.state == type(history.state)(None, 0, 0, None)
        history.close()

    asyncio.run(main())
    assert values_in(tmp_path / "h.db") == [
        *range(100),
        *(f"{n} {'x' * 100}" for n in range(100, 200)),
    ]


def test_what_is_written_twice_because_the_gateway_was_stopped_meanwhile_is_there_once(
    tmp_path: Path,
) -> None:
    async def main() -> None:
        history = History(SqliteStore(tmp_path / "h.db"), every=SOON)
        for round_ in range(20):
            running = asyncio.create_task(history.run())
            history.append([sample(round_, round_)])
            for _ in range(round_):
                await asyncio.sleep(SOON / 10)
            running.cancel()
            history.close = lambda: None  # type: ignore[method-assign]
            await asyncio.gather(running, return_exceptions=True)
            history.append([sample(round_ + 0.5, round_ + 0.5)])
            await history._write(0.0)
        del history.close
        history.close()

    asyncio.run(main())
    assert values_in(tmp_path / "h.db") == [n / 2 if n % 2 else n // 2 for n in range(40)]


def test_a_clock_that_is_wrong_for_a_while_costs_no_history(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is old is known only where wall time has been the same for an hour."""
    monkeypatch.setattr("multidrop.gateway.history.sqlite.SEAL_ALL", 1)
    years = 1e8  # s

    async def main() -> None:
        history = History(SqliteStore(tmp_path / "h.db"), keep=1800.0)
        for second in range(4):
            history.append([sample(second, second)])
            await history._write(1000.0 + second)
        for second in range(5, 3605, 100):
            history.append([sample(second, second, step=years)])
            await history._write(1000.0 + second)
        assert values_in(tmp_path / "h.db")[:5] == [0, 1, 2, 3, 5]
        for second in range(3605, 5000, 100):
            history.append([sample(second, second, step=years)])
            await history._write(1000.0 + second)
        half_an_hour = [list(range(first, 5000, 100)) for first in (3005, 3105)]
        assert values_in(tmp_path / "h.db") in half_an_hour
        history.close()

    asyncio.run(main())


def test_a_file_that_is_no_history_is_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "h.db"
    with sqlite3.connect(path) as other:
        other.execute("CREATE TABLE t (x)")
    other.close()
    before = path.read_bytes()
    with pytest.raises(UsageError, match="not a history of multidrop"):
        SqliteStore(path)
    assert path.read_bytes() == before


def test_a_history_of_another_version_is_refused(tmp_path: Path) -> None:
    SqliteStore(tmp_path / "h.db").close()
    other = sqlite3.connect(tmp_path / "h.db")
    other.execute("PRAGMA user_version = 2")
    other.close()
    with pytest.raises(UsageError, match="version 2 of a history; this is version 1"):
        SqliteStore(tmp_path / "h.db")


def test_who_only_reads_makes_no_file_and_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no history"):
        SqliteStore(tmp_path / "h.db", only_read=True)
    assert list(tmp_path.iterdir()) == []
    SqliteStore(tmp_path / "h.db").close()
    store = SqliteStore(tmp_path / "h.db", only_read=True)
    with pytest.raises(sqlite3.OperationalError):
        store._writer.execute("DELETE FROM series")
    store.close()


def test_a_damaged_file_is_told_and_no_bug(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("multidrop.gateway.history.sqlite.SEAL_ALL", 1)

    async def main() -> None:
        store = SqliteStore(tmp_path / "h.db")
        history = History(store)
        history.append([sample(0, 1)])
        await history._write(0.0)
        store._writer.execute("UPDATE blocks SET data = x'0102'")
        with pytest.raises(PortError, match="the history is damaged"):
            await history.range("infeed", "speed", 0, END)
        history.close()

    asyncio.run(main())


def test_the_store_is_the_one_that_the_settings_name(tmp_path: Path) -> None:
    store = open_store(HistorySettings(path="x.db"), lambda text: tmp_path / text)
    assert isinstance(store, SqliteStore)
    assert store.path == tmp_path / "x.db"
    store.close()
    with pytest.raises(UsageError, match=r"history\.dsn is wrong"):
        open_store(HistorySettings(dsn="postgresql://x?nonsense=1"), lambda text: tmp_path / text)


def test_a_point_that_first_came_while_the_disk_was_full_is_found_afterwards(
    tmp_path: Path,
) -> None:
    store = SqliteStore(tmp_path / "h.db")
    store.write(batches([sample(0, 1)]))
    (pages,) = store._writer.execute("PRAGMA page_count").fetchone()
    store._writer.execute(f"PRAGMA max_page_count = {pages}")
    later = batches([sample(second, "x" * 50, point="new") for second in range(200)], run="later")
    with pytest.raises(sqlite3.OperationalError, match="full"):
        store.write(later)
    assert store._fresh.total() == 1
    store._writer.execute("PRAGMA max_page_count = 100000")
    store.write(batches([sample(0, 2, point="other")], run="other"))
    store.write(later)
    store.close()
    assert values_in(tmp_path / "h.db", "new") == ["x" * 50] * 200
    assert values_in(tmp_path / "h.db", "other") == [2]
