"""States that wait for a broker: with a real outbox, and a client that confirms what it is told to."""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import aiomqtt
import pytest

from multidrop.errors import PortError
from multidrop.gateway.history.packing import pack
from multidrop.gateway.history.records import Batch, Span
from multidrop.gateway.mqtt import outbox as mqtt_outbox
from multidrop.gateway.mqtt.broker import AT_ONCE
from multidrop.gateway.mqtt.outbox import KEEP_EVERY, LOTS_AT_ONCE, Backlog
from multidrop.gateway.mqtt.topics import Topics
from multidrop.gateway.outbox import Outbox
from unit.gateway.updates import update

TOPICS = Topics("m")
TOPIC = "m/infeed/p"
ROOM = 1_000_000
BATCH = Batch(1, Span("run", 1, 0, 0, None), 1)


class Client:
    """Takes everything, and confirms the first `confirms` messages; then it hangs, or fails."""

    def __init__(self, confirms: float = float("inf"), *, hangs: bool = False) -> None:
        self.confirms = confirms
        self.hangs = hangs
        self.given: list[tuple[str, dict[str, Any], bool]] = []
        self.free = asyncio.Event()

    async def publish(
        self, topic: str, payload: str, *, qos: int, retain: bool, timeout: float
    ) -> None:
        assert qos == 1
        self.given.append((topic, json.loads(payload), retain))
        if len(self.given) > self.confirms:
            if not self.hangs:
                raise aiomqtt.MqttError("gone")
            await self.free.wait()

    @property
    def values(self) -> list[Any]:
        return [payload["value"] for topic, payload, _ in self.given if topic == TOPIC]


class Place:
    """A backlog on a real outbox; `now` is what it takes for the time, s."""

    def __init__(self, folder: Path, most: int = ROOM) -> None:
        self.path = folder / "outbox.db"
        self.now = 0.0
        self.outbox = Outbox(self.path, most)
        self.backlog = Backlog(self.outbox, lambda: self.now)
        self._count = 0

    def add(self, *values: int) -> None:
        for value in values:
            self._count += 1
            self.backlog.add(TOPIC, update(value=value, at=float(value)))

    async def store(self) -> None:
        """What is in memory has waited for too long."""
        self.now += KEEP_EVERY
        await self.backlog.keep()

    async def deliver(self, client: Client, retained: tuple[str, ...] = (TOPIC,)) -> Client:
        await self.backlog.deliver(cast("aiomqtt.Client", client), TOPICS, retained)
        return client

    async def break_off(self, client: Client) -> Client:
        with pytest.raises(aiomqtt.MqttError, match="gone"):
            await self.deliver(client)
        await self.backlog.put_back()
        return client

    def on_disk(self) -> int:
        with sqlite3.connect(self.path) as file:
            (count,) = file.execute("SELECT coalesce(sum(samples), 0) FROM records").fetchone()
        file.close()
        return int(count)


def ran(folder: Path, test: Callable[[Place], Awaitable[None]], most: int = ROOM) -> None:
    async def main() -> None:
        place = Place(folder, most)
        async with place.backlog:
            await test(place)

    asyncio.run(main())


def test_while_the_broker_confirms_nothing_is_written(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        before = place.outbox._file.total_changes
        client = Client()
        for value in range(100):
            place.add(value)
            await place.deliver(client)
            await place.store()
        assert client.values == list(range(100))
        assert all(retained for _, _, retained in client.given)
        assert place.outbox._file.total_changes == before
        assert place.backlog.waiting == 0

    ran(tmp_path, test)


def test_what_waited_follows_in_order_and_what_is_new_behind_it(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        place.add(*range(100))
        await place.store()
        place.add(100, 101)
        assert place.backlog.waiting == 102
        assert place.on_disk() == 100
        client = await place.deliver(Client())
        assert client.values == list(range(102))
        assert place.backlog.followed == 100
        assert (place.backlog.waiting, place.on_disk()) == (0, 0)

    ran(tmp_path, test)


def test_what_has_not_waited_long_stays_in_memory(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        place.add(1)
        place.now += KEEP_EVERY / 2
        await place.backlog.keep()
        assert place.on_disk() == 0
        await place.store()
        assert place.on_disk() == 1

    ran(tmp_path, test)


@pytest.mark.parametrize("stored", [False, True])
def test_what_was_not_confirmed_comes_again_as_the_same_records(
    tmp_path: Path, stored: bool
) -> None:
    async def test(place: Place) -> None:
        place.add(*range(3 * AT_ONCE))
        if stored:
            await place.store()
        first = await place.break_off(Client(AT_ONCE + 5))
        again = await place.deliver(Client())
        assert again.values == list(range(AT_ONCE, 3 * AT_ONCE))
        records = {payload["value"]: payload["record"] for _, payload, _ in first.given}
        for _, payload, _ in again.given:
            assert payload["record"] == records.get(payload["value"], payload["record"])
        found = [payload["record"] for _, payload, _ in again.given]
        assert found == sorted(found)

    ran(tmp_path, test)


async def silent_with_two(place: Place) -> tuple[Client, asyncio.Task[Client]]:
    """A broker that has two states and confirms none, and the delivery that waits for it."""
    place.add(1, 2)
    client = Client(0, hangs=True)
    sending = asyncio.create_task(place.deliver(client))
    while len(client.given) < 2:
        await asyncio.sleep(0)
    return client, sending


def test_what_a_silent_broker_has_not_confirmed_is_on_the_disk(tmp_path: Path) -> None:
    """And what it confirms in the end does not come again."""

    async def test(place: Place) -> None:
        client, sending = await silent_with_two(place)
        place.add(3)
        await place.store()
        assert place.on_disk() == 3
        assert place.backlog.waiting == 3
        client.free.set()
        await sending
        assert client.values == [1, 2, 3]
        assert (place.backlog.waiting, place.on_disk()) == (0, 0)

    ran(tmp_path, test)


def test_what_a_silent_broker_never_confirms_comes_first(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        _, sending = await silent_with_two(place)
        place.add(3)
        await place.store()
        sending.cancel()
        await asyncio.wait([sending])
        await place.backlog.put_back()
        place.add(4)
        assert (await place.deliver(Client())).values == [1, 2, 3, 4]

    ran(tmp_path, test)


def test_a_connection_that_breaks_leaves_nobody_waiting(tmp_path: Path) -> None:
    """Some of a lot wait for their confirmation while the next is refused."""

    class Breaks(Client):
        async def publish(
            self, topic: str, payload: str, *, qos: int, retain: bool, timeout: float
        ) -> None:
            self.hangs = len(self.given) < 3
            await super().publish(topic, payload, qos=qos, retain=retain, timeout=timeout)

    async def test(place: Place) -> None:
        others = asyncio.all_tasks()
        place.add(*range(5))
        await place.break_off(Breaks(0))
        await asyncio.sleep(0)
        assert asyncio.all_tasks() == others

    ran(tmp_path, test)


def test_what_was_delivered_leaves_the_disk_while_more_follows(tmp_path: Path) -> None:
    """So a kill in the middle of a long backlog makes a second of it come again, and not all."""

    async def test(place: Place) -> None:
        class Clocked(Client):
            async def publish(
                self, topic: str, payload: str, *, qos: int, retain: bool, timeout: float
            ) -> None:
                place.now += 0.01
                await super().publish(topic, payload, qos=qos, retain=retain, timeout=timeout)

        place.add(*range((LOTS_AT_ONCE + 4) * AT_ONCE))
        await place.store()
        await place.break_off(Clocked((LOTS_AT_ONCE + 2) * AT_ONCE))
        assert place.on_disk() <= 4 * AT_ONCE

    ran(tmp_path, test)


def test_a_backlog_waits_for_the_next_run(tmp_path: Path) -> None:
    async def stored(place: Place) -> None:
        place.add(1)
        await place.store()
        place.add(2)  # in memory until it ends

    async def next_run(place: Place) -> None:
        place.add(3)
        client = await place.deliver(Client())
        assert client.values == [1, 2, 3]
        records = [payload["record"] for _, payload, _ in client.given]
        assert records[0][0] == records[1][0] < records[2][0]
        assert records == sorted(records)

    ran(tmp_path, stored)
    ran(tmp_path, next_run)


def test_a_run_in_a_new_file_has_a_higher_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = 1_800_000_000.0
    monkeypatch.setattr("multidrop.gateway.outbox.time.time", lambda: clock)
    outbox = Outbox(tmp_path / "one.db", ROOM)
    first = outbox.begin_run()
    clock -= 1e6  # a clock that steps back
    assert outbox.begin_run() == first + 1
    outbox.close()
    clock += 2e6
    new = Outbox(tmp_path / "other.db", ROOM)
    assert new.begin_run() > first + 1
    new.close()


def test_the_same_update_again_is_the_same_record(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        one = update(value=1)
        place.backlog.add(TOPIC, one)
        place.backlog.add(TOPIC, one)
        place.backlog.add(TOPIC, update(value=1))
        client = await place.deliver(Client())
        numbers = [payload["record"][1] for _, payload, _ in client.given]
        assert numbers == [1, 1, 2]

    ran(tmp_path, test)


def test_what_is_polled_no_more_is_not_retained(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        place.add(1)
        client = await place.deliver(Client(), retained=())
        assert [retained for _, _, retained in client.given] == [False]

    ran(tmp_path, test)


def test_beyond_the_bound_the_gap_stands_in_its_place(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        values = 20 * AT_ONCE
        for first in range(0, values, AT_ONCE):
            place.add(*range(first, first + AT_ONCE))
            await place.store()
        client = await place.deliver(Client())
        (topic, gap, retained), first_state, *_ = client.given
        assert (topic, retained) == ("m/gap", False)
        lost = values - len(client.values)
        assert client.values == list(range(lost, values))
        assert gap == {
            "from": "2026-11-22T12:00:00.000000Z",
            "until": f"2026-11-22T12:{(lost - 1) // 60:02}:{(lost - 1) % 60:02}.000000Z",
            "states": lost,
            "reason": "the outbox was full",
            "before": first_state[1]["record"],
        }
        assert [topic for topic, _, _ in client.given].count("m/gap") == 1

    ran(tmp_path, test, most=4000)


def test_a_full_disk_costs_the_oldest_only_beyond_a_bound_and_leaves_a_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt_outbox, "MOST_IN_MEMORY", 10)

    async def test(place: Place) -> None:
        place.outbox._file.execute("PRAGMA query_only = 1")
        place.add(*range(8))
        await place.store()
        assert place.backlog.error is not None
        assert "readonly" in place.backlog.error
        place.add(*range(8, 13))
        await place.store()
        place.outbox._file.execute("PRAGMA query_only = 0")
        place.add(13)
        await place.store()
        assert place.backlog.error is None
        client = await place.deliver(Client())
        topic, gap, _ = client.given[0]
        assert (topic, gap["states"], gap["until"]) == ("m/gap", 4, "2026-11-22T12:00:03.000000Z")
        assert client.values == list(range(4, 14))

    ran(tmp_path, test)


def test_the_bound_is_told_in_hours_while_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And it is the same, but for what compresses otherwise, when everything is."""

    async def test(place: Place) -> None:
        monkeypatch.setattr("multidrop.gateway.outbox.time.monotonic", lambda: place.now)
        assert place.backlog.hours is None
        assert "room" not in str(place.backlog)
        client = Client()
        for value in range(0, 40 * AT_ONCE, AT_ONCE):
            place.add(*range(value, value + AT_ONCE))
            await place.deliver(client)
            await place.store()
        told = place.backlog.hours
        assert told is not None
        assert f"with room for {told:.3g} h" in str(place.backlog)
        place.now += 1000
        for value in range(40 * AT_ONCE, 80 * AT_ONCE, AT_ONCE):
            place.add(*range(value, value + AT_ONCE))
            await place.store()
        assert place.backlog.hours == pytest.approx(told, rel=0.2)

    ran(tmp_path, test)


def test_an_outbox_that_cannot_be_read_ends_the_connection(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        place.add(1)
        await place.store()
        place.outbox._file.execute("ALTER TABLE records RENAME TO gone")
        with pytest.raises(aiomqtt.MqttError, match=r"outbox.db: no such table"):
            await place.deliver(Client())
        place.outbox._file.execute("ALTER TABLE gone RENAME TO records")
        assert (await place.deliver(Client())).values == [1]

    ran(tmp_path, test)


@pytest.mark.parametrize("data", [b"", b"no states", pack(BATCH)])
def test_what_are_no_states_is_not_published(tmp_path: Path, data: bytes) -> None:
    async def test(place: Place) -> None:
        place.outbox.put([(data, 0, 0, 1)])
        place.backlog._behind = True
        with pytest.raises(
            aiomqtt.MqttError, match=r"outbox.db: what waits in it is damaged, or history's"
        ):
            await place.deliver(Client())

    ran(tmp_path, test)


def test_where_nothing_can_be_written_it_is_said_at_once(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path / "outbox.db", ROOM)
    outbox._file.execute("PRAGMA query_only = 1")
    with pytest.raises(PortError, match="no outbox can be kept here"):
        Backlog(outbox)
    outbox.close()
