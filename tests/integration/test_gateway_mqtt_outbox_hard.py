"""What waits for a broker, on worse days: reloads, kills in mid-delivery, full outboxes and full disks."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import signal
import sqlite3
import ssl
import subprocess
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from integration.counting import CountingLine, counting, stop, wait_until
from integration.gateways import Client as HttpClient
from integration.mosquitto import Broker, found
from integration.processes import Running
from integration.proxy import Proxy, proxy_to
from integration.test_campaigns_full import Disk, limited, small
from integration.test_gateway_mqtt import Watcher, certificate, watcher
from integration.test_gateway_mqtt_outbox import (
    STATUS,
    Site,
    all_in_order_and_once,
    away,
    back,
    numbers,
    said,
    site,
    standing_still,
    until_count,
)
from multidrop.gateway.mqtt.broker import AT_ONCE, Client
from multidrop.gateway.mqtt.lots import Lot, State, packed
from multidrop.gateway.outbox import Outbox

OUTBOX = "mqtt-outbox.db"
OLD = "multidrop/line0/feed"
ROOMY = ("allow_anonymous true", "max_queued_messages 0")
"""A broker that keeps whatever a subscriber is slow to take."""


def online(text: Any) -> bool:
    return bool(text == "online")


def by_record(watching: Watcher, topic: str) -> tuple[list[tuple[int, int]], int]:
    """The records of a topic as a subscriber keeps them who drops what is not newer, and how many it dropped."""
    kept, dropped = [(0, 0)], 0
    for message in watching.messages:
        if str(message.topic) == topic and b'"record"' in bytes(message.payload):
            record = tuple(json.loads(message.payload)["record"])
            if record > kept[-1]:
                kept.append(record)
            else:
                dropped += 1
    return kept[1:], dropped


def filled(folder: Path, states: int, each: int = 0) -> None:
    """An outbox with so many states of an earlier run, with `each` bytes of chance in them."""
    chance = random.Random(7)
    outbox = Outbox(folder / OUTBOX, 10**9)
    run = outbox.begin_run()
    lots = []
    for first in range(0, states, AT_ONCE):
        lot = []
        for number in range(first, min(first + AT_ONCE, states)):
            record = (run, number + 1)
            facts = {"value": number, "filling": chance.randbytes(each).hex(), "record": record}
            lot.append(State(OLD, json.dumps(facts), number + 1, record, 0.0))
        lots.append(packed(Lot(lot)))
    outbox.put(lots)
    outbox.close()


# -- the plant file is read again -----------------------------------------------------------------


@pytest.mark.parametrize("change", ["another outbox", "no outbox"])
def test_a_reload_while_the_broker_is_away(tmp_path: Path, change: str) -> None:
    """What waits goes on waiting in the same outbox; a new line waits behind it. Nothing is lost or doubled."""
    with site(tmp_path) as place, place.gateway() as program:
        status = HttpClient(said(program, "http://").strip())
        said(program, "mqtt: connected")
        place.lines[0].wait_for_more(10)
        place.mosquitto.kill()
        since = place.given()
        away(program)
        place.lines[0].wait_for_more(40)
        before = status.get("/api/status").json["mqtt"]["waiting"]
        new = CountingLine("late")
        with counting(new):
            file = tmp_path / "multidrop.toml"
            text = file.read_text() + new.toml
            if change == "another outbox":
                text = text.replace(OUTBOX, "other.db")
            else:
                text = text.replace(f'outbox = "{OUTBOX}"\n', "")
            file.write_text(text)
            program.process.send_signal(signal.SIGHUP)
            said(program, "reloaded: started late")
            new.wait_for_more(30)
            assert status.get("/api/status").json["mqtt"]["waiting"] > before
            assert not (tmp_path / "other.db").exists()

            async def heard() -> None:
                async with back(place) as watching:
                    await watching.until(STATUS, online)
                    for line in (*place.lines, new):
                        await until_count(watching, line, len(line.given) + 10)
                    all_in_order_and_once(watching, place, since)
                    found = numbers(watching, new)
                    assert found == list(range(1, found[-1] + 1))

            asyncio.run(heard())
            stop(program)


def test_a_reload_that_takes_a_line_away_while_the_broker_is_away(tmp_path: Path) -> None:
    """What waited of it is sent, and none of it is left behind at the broker."""
    with site(tmp_path) as place, place.gateway() as program:
        said(program, "mqtt: connected")
        place.lines[0].wait_for_more(10)
        place.mosquitto.kill()
        away(program)
        place.lines[1].wait_for_more(40)
        last = len(place.lines[1].given)
        file = tmp_path / "multidrop.toml"
        file.write_text(file.read_text().replace(place.lines[1].toml, ""))
        program.process.send_signal(signal.SIGHUP)
        said(program, "reloaded: stopped line1")

        async def heard() -> None:
            async with back(place) as watching:
                await watching.until(STATUS, online)
                assert numbers(watching, place.lines[1])[-1] >= last
                await until_count(watching, place.lines[0], len(place.lines[0].given) + 10)
            async with watcher(place.mosquitto) as later:
                await later.until("multidrop/line0/count")
                await asyncio.sleep(0.3)
                assert not [topic for topic in later.seen if "line1" in topic]

        asyncio.run(heard())
        stop(program)


# -- kills ----------------------------------------------------------------------------------------


def test_a_gateway_that_is_killed_in_the_middle_of_a_delivery(tmp_path: Path) -> None:
    """Everything comes in order; what comes twice is known by its record, and is of about a second."""
    states = 3_000
    filled(tmp_path, states)

    async def heard(place: Site, way: Proxy) -> None:
        async with watcher(place.mosquitto) as watching:
            for _ in range(2):
                before = in_file(tmp_path)
                with place.gateway() as program:
                    await asyncio.to_thread(wait_until, partial(less_in_file, tmp_path, before))
                    program.end()
            assert 0 < in_file(tmp_path) < states
            way.pause = 0.0
            with place.gateway() as program:
                await asyncio.to_thread(said, program, "have followed")
                await until_count(watching, place.lines[0], len(place.lines[0].given))
                found, dropped = by_record(watching, OLD)
                run = found[0][0]
                assert found[:states] == [(run, number + 1) for number in range(states)]
                assert all(record > (run, states) for record in found[states:])
                assert 0 < dropped < states
                await asyncio.to_thread(stop, program)

    with site(tmp_path, "", *ROOMY) as near, proxy_to("127.0.0.1", near.mosquitto.port) as way:
        way.pause = 0.02
        asyncio.run(heard(Site(tmp_path, near.mosquitto, near.lines, way.port, ""), way))


def test_a_broker_that_is_killed_again_and_again(tmp_path: Path) -> None:
    """Missing is only what a broker had just confirmed when it was killed: that is the broker's."""
    kills: list[float] = []

    async def heard(place: Site) -> list[int]:
        found: list[int] = []
        for number in range(5):
            async with back(place) if number else watcher(place.mosquitto) as watching:
                await watching.until(STATUS, online)
                await until_count(watching, place.lines[0], len(place.lines[0].given) + 2 * number)
                found += numbers(watching, place.lines[0])
                kills.append(time.monotonic())
                await asyncio.to_thread(place.mosquitto.kill)
            await asyncio.to_thread(place.lines[0].wait_for_more, 5 * number)
        return found

    with site(tmp_path) as place, place.gateway() as program:
        line = place.lines[0]
        found = asyncio.run(heard(place))
        kept = sorted(set(found))
        lost = set(range(kept[0], kept[-1] + 1)) - set(kept)
        given = {one.number: one.monotonic for one in line.given}
        for number in lost:
            assert min(abs(given[number] - kill) for kill in kills) < 0.5, (number, kills)
        assert program.process.poll() is None
        stop(program)
        assert "Traceback" not in "".join(program.err)


def test_tls_with_user_and_password(tmp_path: Path) -> None:
    """What waited follows over it as without, and so do commands that come together."""
    own = certificate(tmp_path, "own")
    passwords = tmp_path / "passwords"
    subprocess.run(
        [found("mosquitto_passwd"), "-b", "-c", str(passwords), "press", "secret"], check=True
    )
    passwords.chmod(0o644)
    (tmp_path / "password.txt").write_text("secret\n")
    settings = [
        "allow_anonymous false",
        f"password_file {passwords}",
        f"certfile {own}",
        f"keyfile {tmp_path / 'own.key'}",
    ]
    more = f'''
tls = true
authority = "{own}"
user = "press"
password = "password.txt"
commands = true
'''
    context = ssl.create_default_context(cafile=own)

    @contextlib.asynccontextmanager
    async def listening(mosquitto: Broker) -> AsyncIterator[Watcher]:
        async with Client(
            "127.0.0.1",
            mosquitto.port,
            protocol=aiomqtt.ProtocolVersion.V5,
            tls_context=context,
            username="press",
            password="secret",
        ) as client:
            await client.subscribe("multidrop/#", qos=2)
            await client.subscribe("answers/#", qos=2)
            yield Watcher(client)

    async def heard(place: Site, program: Running, since: list[int]) -> None:
        async with contextlib.AsyncExitStack() as stack:
            with standing_still(program):
                place.mosquitto.start()
                watching = await stack.enter_async_context(listening(place.mosquitto))
            await watching.until(STATUS, online)
            for line in place.lines:
                await until_count(watching, line, len(line.given) + 10)
            all_in_order_and_once(watching, place, since)
            start = time.monotonic()
            for value in range(6):
                await watching.command(str(value), f"multidrop/line{value % 2}/feed/set")
            for _ in range(6):
                answer = await watching.answer()
                assert answer["outcome"] == "confirmed"
            assert time.monotonic() - start < 2

    with site(tmp_path, more, *settings) as place, place.gateway() as program:
        said(program, "mqtt: connected")
        place.lines[0].wait_for_more(10)
        place.mosquitto.kill()
        since = place.given()
        away(program)
        place.lines[0].wait_for_more(40)
        asyncio.run(heard(place, program, since))
        stop(program)
        assert "secret" not in "".join([*program.out, *program.err])


def test_an_outbox_that_is_damaged_does_not_end_the_gateway(tmp_path: Path) -> None:
    """Nothing goes to the broker, which is said; the plant is polled."""
    filled(tmp_path, 1)
    with contextlib.closing(sqlite3.connect(tmp_path / OUTBOX)) as file, file:
        file.execute("UPDATE records SET data = zeroblob(10)")
    with site(tmp_path) as place, place.gateway() as program:
        status = HttpClient(said(program, "http://").strip())
        assert "what waits in it is damaged" in said(program, "is away")
        place.lines[0].wait_for_more(20)
        (trouble,) = status.get("/api/status").json["troubles"]
        assert "what waits in it is damaged" in trouble["text"]
        stop(program)


# -- no more room ---------------------------------------------------------------------------------


def test_an_outbox_that_is_full_gives_up_the_oldest_and_says_how_many(tmp_path: Path) -> None:
    """Every state comes in order, or is counted in a gap that stands in its place: also in those of what
    new states push out while the first ones are on their way.
    """
    states = 9_600
    filled(tmp_path, states, 100)
    with site(tmp_path, "outbox_size = 1", *ROOMY) as place:
        place.mosquitto.kill()
        with place.gateway() as program:
            away(program)
            place.lines[0].wait_for_more(100)

            async def heard() -> None:
                async with back(place) as watching:
                    await watching.until(STATUS, online)
                    came, lost = states_and_gaps(watching, OLD)
                    assert lost[0] == came[0] - 1
                    assert sum(lost) + len(came) == states
                    assert came[-1] == states
                    assert len(came) > 1_000
                    assert numbers(watching, place.lines[1])[0] == 1

            asyncio.run(heard())
            stop(program)


def states_and_gaps(watching: Watcher, topic: str) -> tuple[list[int], list[int]]:
    """Numbers of the first run's states, as they came, and how many each gap before one of them counts."""
    came: list[int] = []
    lost: list[int] = []
    gap: dict[str, Any] = {}
    first_run = None
    for message in watching.messages:
        facts = json.loads(message.payload) if str(message.topic) != STATUS else {}
        if str(message.topic) == "multidrop/gap":
            gap = facts
        elif str(message.topic) == topic and "record" in facts:
            run, number = facts["record"]
            first_run = first_run or run
            if run == first_run:
                missing = gap["states"] if gap.get("before") == [run, number] else 0
                assert number == (came[-1] if came else 0) + 1 + missing
                lost += [missing] if missing else []
                came.append(number)
    return came, lost


@pytest.mark.parametrize("kind", [limited, small])
def test_a_disk_that_is_full_for_a_while(
    tmp_path: Path, kind: Callable[[Path], AbstractContextManager[Disk]]
) -> None:
    """States wait in memory then, which is said; they are on the disk once there is room, and nothing is lost."""
    with kind(tmp_path) as disk, site(disk.folder) as place, place.gateway() as program:
        status = HttpClient(said(program, "http://").strip())

        said(program, "mqtt: connected")
        place.lines[0].wait_for_more(10)
        place.mosquitto.kill()
        since = place.given()
        away(program)
        place.lines[0].wait_for_more(20)
        assert (health(status), status.get("/health").status) == ("waiting", 200)
        disk.fill(program)
        said(program, "mqtt: mqtt-outbox.db: ")
        place.lines[0].wait_for_more(60)
        on_disk = in_file(disk.folder)
        waiting = status.get("/api/status").json["mqtt"]["waiting"]
        assert waiting > on_disk + 50
        assert (health(status), status.get("/health").status) == ("failing", 503)
        disk.empty(program)
        said(program, "mqtt: mqtt-outbox.db is written again")
        wait_until(lambda: in_file(disk.folder) >= waiting)

        async def heard() -> None:
            async with back(place) as watching:
                await watching.until(STATUS, online)
                for line in place.lines:
                    await until_count(watching, line, len(line.given) + 10)
                all_in_order_and_once(watching, place, since)

        asyncio.run(heard())
        assert (health(status), status.get("/health").status) == ("ok", 200)
        stop(program)


def health(client: HttpClient) -> str:
    return str(client.get("/health").json["parts"]["mqtt"])


def less_in_file(folder: Path, before: int) -> bool:
    return in_file(folder) < before


def in_file(folder: Path) -> int:
    with contextlib.closing(sqlite3.connect(folder / OUTBOX)) as file:
        (count,) = file.execute("SELECT coalesce(sum(samples), 0) FROM records").fetchone()
    return int(count)
