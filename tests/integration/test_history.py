"""History that is killed, whose server goes away, whose process is somebody else's."""

from __future__ import annotations

import asyncio
import csv
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from postgres import own_schema, postgres_dsn

from integration import history_writer
from integration.plants import DRIVE
from integration.processes import PATIENCE, environment, multidrop, running
from integration.proxy import Proxy, proxy_to
from integration.threads import served
from multidrop.gateway.history.part import History
from multidrop.gateway.history.records import Sample
from multidrop.gateway.history.sqlite import SqliteStore
from multidrop.gateway.history.store import KILLED, Store
from multidrop.gateway.outbox import Outbox
from multidrop.protocols import slink3
from multidrop.sim.line import SimulatedLine
from multidrop.sim.slink3 import FlexMax

FOREVER = 2**62
KILLS = 20 if os.environ.get("MULTIDROP_SOAK") else 5


def numbers(store: Store, point: str) -> list[int]:
    found = []
    for sample in store.range("d", point, 0, FOREVER):
        assert isinstance(sample.value, int)
        found.append(sample.value)
    return found


def killed_at_random(folder: Path, first: int, *server: str) -> int:
    """Let a process record from `first` on, and kill it; returns up to where it had written."""
    writer = subprocess.Popen(
        [sys.executable, history_writer.__file__, str(folder), str(first), *server],
        stdout=subprocess.PIPE,
        text=True,
        env=environment(),
    )
    assert writer.stdout is not None
    written = int(writer.stdout.readline())
    time.sleep(random.uniform(0.0, 0.4))
    writer.send_signal(signal.SIGKILL)
    for line in writer.stdout.read().splitlines(keepends=True):
        if line.endswith("\n"):
            written = int(line)
    writer.wait(PATIENCE)
    writer.stdout.close()
    return written


def runs_of(found: list[int]) -> list[list[int]]:
    """Cut where a number does not follow the one before."""
    runs = [[found[0]]]
    for number in found[1:]:
        if number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return runs


@pytest.fixture(params=["sqlite", "postgres"])
def server(request: pytest.FixtureRequest) -> Iterator[tuple[str, ...]]:
    """Arguments of `history_writer.open_store` behind the folder."""
    if request.param == "sqlite":
        yield ()
        return
    dsn = postgres_dsn()
    with own_schema() as schema:
        yield dsn, schema


def test_killed_at_any_moment_it_keeps_what_was_written_in_order_and_once(
    tmp_path: Path, server: tuple[str, ...]
) -> None:
    starts, writtens = [], []
    for number in range(KILLS):
        starts.append(number * 1_000_000)
        writtens.append(killed_at_random(tmp_path, starts[-1], *server))
    store = history_writer.open_store(tmp_path, *server)
    try:
        until = time.monotonic() + PATIENCE
        while server and not store.delivered:
            assert time.monotonic() < until, store.state
            time.sleep(0.01)
        for point in ("a", "b"):
            runs = runs_of(numbers(store, point))
            assert [run[0] for run in runs] == starts
            for run, written in zip(runs, writtens, strict=True):
                assert run[-1] >= written - 1
        gaps = store.gaps(0, FOREVER)
        assert [gap.reason for gap in gaps] == [KILLED] * (KILLS - 1)
        found = list(store.range("d", "a", 0, FOREVER))
        for gap in gaps:
            assert not [sample for sample in found if gap.start < sample.time < gap.end]
            assert any(sample.time == gap.end for sample in found)
    finally:
        store.close()


# -- a server that is away -----------------------------------------------------------------------


def through(proxy: Proxy, dsn: str) -> str:
    parts = urlsplit(dsn)
    user = f"{parts.netloc.rpartition('@')[0]}@" if "@" in parts.netloc else ""
    return parts._replace(netloc=f"{user}127.0.0.1:{proxy.port}").geturl()


class Feeding:
    """Counts up into a history, 100 samples at a time."""

    def __init__(self, history: History) -> None:
        self.history = history
        self.number = 0

    def feed(self) -> None:
        samples = []
        for _ in range(100):
            self.number += 1
            now = self.number / 1000
            samples.append(Sample("d", "a", 10**15 + self.number * 1000, now, True, self.number))
        self.history.append(samples)


async def _until(what: object) -> None:
    async with asyncio.timeout(PATIENCE):
        while not what():  # type: ignore[operator]
            await asyncio.sleep(0.01)


@pytest.fixture
def away() -> Iterator[tuple[Proxy, str, str]]:
    dsn = postgres_dsn()
    parts = urlsplit(dsn)
    with (
        own_schema() as schema,
        proxy_to(parts.hostname or "127.0.0.1", parts.port or 5432) as proxy,
    ):
        yield proxy, through(proxy, dsn), schema


def test_a_server_that_goes_away_under_load_gets_everything_in_order_and_once(
    tmp_path: Path, away: tuple[Proxy, str, str]
) -> None:
    from multidrop.gateway.history.postgres import PostgresStore

    proxy, dsn, schema = away
    proxy.cut()  # it was not there when the gateway started

    async def main() -> None:
        store = PostgresStore(dsn, Outbox(tmp_path / "o.db", 10**8), schema=schema)
        history = History(store, every=0.01)
        feeding = Feeding(history)
        running = asyncio.create_task(history.run())
        for _ in range(3):
            written = history.written
            for _ in range(20):
                feeding.feed()
                await asyncio.sleep(0.005)
            await _until(lambda: history.state.error)
            await _until(lambda written=written: history.written >= written + 2000)
            assert history.state.waiting >= 2000
            proxy.join()
            for _ in range(20):
                feeding.feed()
                await asyncio.sleep(0.005)
            await _until(lambda: store.delivered and history.state.waiting == 0)
            assert history.state.error is None
            feeding.feed()
            proxy.cut()
        proxy.join()
        await _until(lambda: store.delivered and history.state.waiting == 0)
        found = await history.range("d", "a", 0, FOREVER)
        assert [sample.value for sample in found] == list(range(1, feeding.number + 1))
        assert await history.gaps(0, FOREVER) == []
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())


def test_a_server_that_goes_away_at_any_moment_gets_everything_in_order_and_once(
    tmp_path: Path, away: tuple[Proxy, str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also in the middle of a batch, and between a commit and its acknowledgement."""
    import psycopg

    from multidrop.gateway.history.postgres import PostgresStore
    from multidrop.gateway.history.postgres_sending import Writing

    commit = Writing.commit

    def commit_unheard(self: Writing, forget: int | None) -> None:
        commit(self, forget)
        if random.random() < 0.3:
            raise psycopg.OperationalError("the connection was lost")

    monkeypatch.setattr(Writing, "commit", commit_unheard)
    monkeypatch.setattr("multidrop.gateway.history.postgres_sending.RETRY", 0.01)
    monkeypatch.setattr("multidrop.gateway.history.postgres_sending.MUCH", 300)
    proxy, dsn, schema = away
    outbox = Outbox(tmp_path / "o.db", 10**8)
    store = PostgresStore(dsn, outbox, schema=schema, every=0.1)

    async def main() -> None:
        history = History(store, every=0.01)
        feeding = Feeding(history)
        running = asyncio.create_task(history.run())
        for _ in range(6 * KILLS):
            until = time.monotonic() + random.uniform(0.0, 0.15)
            while time.monotonic() < until:
                feeding.feed()
                await asyncio.sleep(0.01)
            proxy.cut()
            await asyncio.sleep(random.uniform(0.0, 0.02))
            proxy.join()
        await _until(lambda: store.delivered and history.state.waiting == 0)
        found = [sample.value for sample in await history.range("d", "a", 0, FOREVER)]
        assert found == list(range(1, feeding.number + 1))
        assert await history.gaps(0, FOREVER) == []
        assert outbox.size == outbox.samples == 0
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())


def test_beyond_its_bound_the_outbox_gives_up_the_oldest_and_says_so(
    tmp_path: Path, away: tuple[Proxy, str, str]
) -> None:
    from multidrop.gateway.history.postgres import PostgresStore

    proxy, dsn, schema = away
    proxy.cut()

    async def main() -> None:
        outbox = Outbox(tmp_path / "o.db", 20_000)
        store = PostgresStore(dsn, outbox, schema=schema)
        history = History(store)
        feeding = Feeding(history)
        for second in range(100):
            feeding.feed()
            await history._write(float(second))
        assert outbox.size <= 20_000  # also of what was tried to deliver
        assert history.state.hours is not None
        proxy.join()
        await _until(lambda: store.delivered)
        found = [sample.value for sample in await history.range("d", "a", 0, FOREVER)]
        (gap,) = await history.gaps(0, FOREVER)
        lost = 10_000 - len(found)
        assert 0 < lost < 10_000
        assert found == list(range(lost + 1, 10_001))
        assert (gap.reason, gap.samples) == ("the outbox was full", lost)
        assert (gap.start, gap.end) == (10**15 + 1000, 10**15 + lost * 1000)
        history.close()

    asyncio.run(main())


# -- the command line --------------------------------------------------------------------------


def test_run_records_and_history_exports_while_it_runs(tmp_path: Path) -> None:
    drive = FlexMax(0)
    with served(SimulatedLine([drive], slink3.decoder)) as address:
        line = f'[line.press]\nport = "{address.port}"\nbaud = 115200\ntimeout = 0.2\n'
        text = line + DRIVE.format(line="press", name="infeed", address=0)
        (tmp_path / "multidrop.toml").write_text(f"{text}\n[history]\nlongest = 1\n")
        audit = str(tmp_path / "audit.jsonl")
        with running("run", cwd=tmp_path, MULTIDROP_AUDIT=audit) as run:
            until = time.monotonic() + PATIENCE
            while "infeed feed" not in multidrop("history", "list", cwd=tmp_path).out:
                assert time.monotonic() < until
            ran = multidrop("history", "export", "infeed", "feed", cwd=tmp_path)
            assert ran.status == 0, ran.err
            assert run.process.poll() is None
        done = multidrop("history", "export", "infeed", "feed", "-o", "f.csv", cwd=tmp_path)
        assert (done.status, done.out) == (0, "")
    rows = list(csv.DictReader((tmp_path / "f.csv").read_text().splitlines()))
    assert rows[0]["quality"] == "good"
    assert [row["time"] for row in rows] == sorted(row["time"] for row in rows)
    assert float(rows[0]["monotonic"]) > 0
    again = multidrop("history", "export", "infeed", "feed", "-o", "f.csv", cwd=tmp_path)
    assert (again.status, "f.csv exists" in again.err) == (2, True)


PLANT = '[line.a]\nport = "/dev/none"\n[history]\n'


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """A history of three samples, a mark, and a second run."""
    from multidrop.gateway.history.batching import Batching
    from multidrop.io.poller import Quality

    (tmp_path / "multidrop.toml").write_text(PLANT)
    noon = 1_795_348_800_000_000  # 2026-11-22T12:00:00Z
    store = SqliteStore(tmp_path / "history.db")
    for number in range(2):
        batching = Batching(f"run {number}")
        start = number * 3600
        values: list[tuple[int, float | str | None, Quality]] = [
            (0, 1.5, Quality.GOOD),
            (1, 'a "word", more', Quality.GOOD),
            (2, None, Quality.PORT_LOST),
        ]
        for second, value, quality in values:
            time_ = noon + (start + second) * 1_000_000
            known = None if second else True
            batching.take([Sample("infeed", "speed", time_, 10.0 + second, known, value, quality)])
        store.write(batching.cut(13.0, stop=True))
    store.close()
    return tmp_path


def test_an_export_has_samples_marks_and_gaps(recorded: Path) -> None:
    ran = multidrop(
        *("history", "export", "infeed", "speed", "--to", "2026-11-22T13:00:01Z"), cwd=recorded
    )
    assert ran.out.splitlines() == [
        "time,value,quality,monotonic,synchronised",
        "2026-11-22T12:00:00.000000Z,1.5,good,10.000000,yes",
        '2026-11-22T12:00:01.000000Z,"a ""word"", more",good,11.000000,',
        "2026-11-22T12:00:02.000000Z,,port lost,12.000000,",
        "2026-11-22T12:00:03.000000Z,,gap until 2026-11-22T13:00:00.000000Z: "
        "the gateway was not running,,",
        "2026-11-22T13:00:00.000000Z,1.5,good,10.000000,yes",
    ]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["infeed", "sped"], "no history of infeed sped - did you mean 'infeed speed'"),
        (["infeed", "speed", "--from", "noon"], "'noon' is no time"),
        (["infeed", "speed", "--from", "2026-11-22", "--to", "2026-11-21"], "not after --from"),
        (["infeed", "speed", "-o", "none/x.csv"], "none/x.csv: No such file"),
        (["infeed", "speed", "--config", "other.toml"], "other.toml: No such file"),
    ],
)
def test_an_export_that_cannot_be(recorded: Path, arguments: list[str], said: str) -> None:
    ran = multidrop("history", "export", *arguments, cwd=recorded)
    assert (ran.status, ran.out) == (2, "")
    assert said in ran.err


def test_an_export_of_no_history(tmp_path: Path) -> None:
    (tmp_path / "multidrop.toml").write_text(PLANT)
    ran = multidrop("history", "export", "infeed", "speed", cwd=tmp_path)
    assert (ran.status, "there is no history" in ran.err) == (2, True)
    assert not (tmp_path / "history.db").exists()


def test_a_server_that_cannot_be_reached_is_exit_status_5(tmp_path: Path) -> None:
    pytest.importorskip("psycopg")
    dsn = "postgresql://nobody@127.0.0.1:1/none"
    (tmp_path / "multidrop.toml").write_text(f'{PLANT}dsn = "{dsn}"\n')
    ran = multidrop("history", "list", cwd=tmp_path)
    assert (ran.status, ran.out) == (5, "")
    assert "the database server does not answer" in ran.err
