"""An outbox on a disk that takes nothing: what is said, what is tried, what is lost. And one that is shared out in turns."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from multidrop.gateway.mqtt.broker import AT_ONCE
from multidrop.gateway.mqtt.outbox import Backlog
from unit.gateway.mqtt.test_outbox import TOPICS, Client, Place, ran

MANY = 20 * AT_ONCE


def full(place: Place, *, is_full: bool = True) -> None:
    place.outbox._file.execute(f"PRAGMA query_only = {int(is_full)}")


def told(place: Place) -> list[str]:
    """What it says from now on."""
    found: list[str] = []
    place.backlog._news = found.append
    return found


def test_it_is_said_once_when_it_begins_and_when_it_ends(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        said = told(place)
        full(place)
        for value in range(3):
            place.add(value)
            await place.store()
        assert len(said) == 1
        assert said[0].startswith(f"mqtt: {place.path}: ")
        assert "readonly" in said[0]
        since = place.backlog.since
        assert since is not None
        full(place, is_full=False)
        await place.store()
        await place.store()
        assert said[1:] == [f"mqtt: {place.path} is written again"]
        full(place)
        place.add(4)
        await place.store()
        assert len(said) == 3
        full(place, is_full=False)

    ran(tmp_path, test)


def test_a_little_is_tried_first_and_then_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ten thousand states twice a second, in vain, would cost the polls their time."""
    tried: list[int] = []
    real = Backlog._write

    def write(backlog: Backlog, lots: list[object]) -> bytes:
        tried.append(len(lots))
        return real(backlog, lots)  # type: ignore[arg-type]

    monkeypatch.setattr(Backlog, "_write", write)

    async def test(place: Place) -> None:
        full(place)
        place.add(*range(MANY))
        await place.store()
        await place.store()
        assert tried == [20, 1]
        full(place, is_full=False)
        await place.store()
        assert tried == [20, 1, 1, 19]
        assert place.on_disk() == MANY
        assert (await place.deliver(Client())).values == list(range(MANY))

    ran(tmp_path, test)


def test_what_is_lost_at_the_end_is_said(tmp_path: Path) -> None:
    said: list[str] = []

    async def test(place: Place) -> None:
        place.backlog._news = said.append
        full(place)
        place.add(1, 2, 3)
        await place.store()

    ran(tmp_path, test)
    assert said[1:] == ["mqtt: 3 states that waited in memory are lost"]


def test_what_comes_meanwhile_waits_for_the_next_time(tmp_path: Path) -> None:
    """Else a plant that always has news would keep everything else from its turn."""

    async def test(place: Place) -> None:
        class Busy(Client):
            async def publish(
                self, topic: str, payload: str, *, qos: int, retain: bool, timeout: float
            ) -> None:
                await super().publish(topic, payload, qos=qos, retain=retain, timeout=timeout)
                if not place.backlog._fresh:
                    place.add(1000 + len(self.given))

        client = Busy()
        place.add(*range(AT_ONCE + 1))
        async with asyncio.timeout(5):
            await place.deliver(client)
        assert place.backlog.waiting > 0

    ran(tmp_path, test)


def test_a_reload_has_its_turn_behind_each_lot(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        place.add(*range(4 * AT_ONCE))
        client = Client()
        await place.backlog.deliver(
            client,  # type: ignore[arg-type]
            TOPICS,
            (),
            lambda: len(client.given) >= 2 * AT_ONCE,
        )
        assert client.values == list(range(2 * AT_ONCE))
        assert place.backlog.waiting == 2 * AT_ONCE

    ran(tmp_path, test)


def test_what_is_taken_together_comes_again_from_where_it_was_confirmed(tmp_path: Path) -> None:
    """And nothing of it is pushed out while it is on its way: it would be sent, and counted as lost."""

    async def test(place: Place) -> None:
        place.add(*range(6 * AT_ONCE))
        await place.store()
        client = await place.break_off(Client(2 * AT_ONCE + 5))
        assert client.values[: 2 * AT_ONCE] == list(range(2 * AT_ONCE))
        again = await place.deliver(Client())
        assert again.values == list(range(2 * AT_ONCE, 6 * AT_ONCE))
        assert (place.backlog.waiting, place.on_disk()) == (0, 0)

    ran(tmp_path, test)


def test_what_is_on_its_way_is_not_pushed_out(tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        class Slow(Client):
            async def publish(
                self, topic: str, payload: str, *, qos: int, retain: bool, timeout: float
            ) -> None:
                await super().publish(topic, payload, qos=qos, retain=retain, timeout=timeout)
                if len(self.given) == AT_ONCE:
                    place.add(*range(6 * AT_ONCE, 40 * AT_ONCE))
                    await place.store()

        place.add(*range(6 * AT_ONCE))
        await place.store()
        client = await place.deliver(Slow())
        gaps = [payload for topic, payload, _ in client.given if topic == "m/gap"]
        assert gaps
        assert client.values[: 6 * AT_ONCE] == list(range(6 * AT_ONCE))
        assert len(client.values) + sum(gap["states"] for gap in gaps) == 40 * AT_ONCE

    ran(tmp_path, test, most=8_000)
