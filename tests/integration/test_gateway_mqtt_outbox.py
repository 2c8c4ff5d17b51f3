"""States that wait for a broker that is away: a real Mosquitto that is killed, gateways that are too."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sqlite3
import sys
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import aiomqtt

from integration import impatient
from integration.counting import CountingLine, counting, stop, wait_until
from integration.gateways import Client as HttpClient
from integration.mosquitto import Broker, broker
from integration.processes import Running
from integration.proxy import Proxy
from integration.test_gateway_mqtt import Watcher, watcher
from multidrop.gateway.mqtt.broker import AT_ONCE, Client, publish_together

STATUS = "multidrop/status"


class Site:
    """Drives that count, a gateway with an outbox, and a broker."""

    def __init__(
        self, folder: Path, mosquitto: Broker, lines: list[CountingLine], port: int, more: str
    ) -> None:
        self.folder, self.mosquitto, self.lines = folder, mosquitto, lines
        self.program: Running | None = None
        mqtt = f'[mqtt]\nhost = "127.0.0.1"\nport = {port}\noutbox = "mqtt-outbox.db"\n{more}\n'
        http = '[http]\nlisten = "127.0.0.1:0"\n'
        text = "".join(line.toml for line in lines) + mqtt + http
        (folder / "multidrop.toml").write_text(text)

    @contextmanager
    def gateway(self) -> Iterator[Running]:
        program = self.program = Running(sys.executable, impatient.__file__, "run", cwd=self.folder)
        try:
            yield program
        finally:
            program.end()

    def given(self) -> list[int]:
        return [len(line.given) for line in self.lines]


@contextmanager
def site(folder: Path, more: str = "", *settings: str) -> Iterator[Site]:
    """`more` is added to `[mqtt]`, `settings` are the broker's."""
    with ExitStack() as stack:
        mosquitto = stack.enter_context(broker(folder, *settings))
        lines = [CountingLine(f"line{number}") for number in range(2)]
        stack.enter_context(counting(*lines))
        yield Site(folder, mosquitto, lines, mosquitto.port, more)


@contextmanager
def cuttable(folder: Path, more: str = "") -> Iterator[tuple[Site, Proxy]]:
    """The gateway reaches its broker by a way that can be cut, while others still reach it."""
    with site(folder) as place, contextlib.closing(Proxy("127.0.0.1", place.mosquitto.port)) as way:
        yield Site(folder, place.mosquitto, place.lines, way.port, more), way


def said(program: Running, text: str, times: int = 1) -> str:
    """Wait until the gateway has said it so often; the last such line."""

    def lines() -> list[str]:
        return [line for line in [*program.out, *program.err] if text in line]

    wait_until(lambda: len(lines()) >= times)
    return lines()[-1]


def away(program: Running) -> None:
    assert "states wait in mqtt-outbox.db" in said(program, "is away")


def numbers(watching: Watcher, line: CountingLine) -> list[int]:
    """What a subscriber heard of a drive's `count`, as it came."""
    states = [
        json.loads(message.payload)
        for message in watching.messages
        if str(message.topic) == f"multidrop/{line.name}/count" and message.payload
    ]
    return [state["value"] for state in states if state["value"] is not None]


def records(watching: Watcher, topic: str) -> list[tuple[int, int]]:
    payloads = [json.loads(m.payload) for m in watching.messages if str(m.topic) == topic]
    return [tuple(one["record"]) for one in payloads if "record" in one]


@contextmanager
def standing_still(program: Running) -> Iterator[None]:
    """So that who listens is there before the gateway is."""
    program.process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        program.process.send_signal(signal.SIGCONT)


@contextlib.asynccontextmanager
async def back(place: Site) -> AsyncIterator[Watcher]:
    """A broker that is there again, and somebody who hears everything from then on."""
    assert place.program is not None
    async with contextlib.AsyncExitStack() as stack:
        with standing_still(place.program):
            place.mosquitto.start()
            watching = await stack.enter_async_context(watcher(place.mosquitto))
        yield watching


async def until_count(watching: Watcher, line: CountingLine, least: int) -> None:
    def enough(state: Any) -> bool:
        return (state["value"] or 0) >= least

    await watching.until(f"multidrop/{line.name}/count", enough)


def all_in_order_and_once(watching: Watcher, place: Site, since: list[int]) -> None:
    for line, first in zip(place.lines, since, strict=True):
        found = numbers(watching, line)
        assert found == list(range(found[0], found[-1] + 1))
        assert found[0] <= first + 1


def test_a_broker_that_is_killed_is_given_everything_when_it_is_back(tmp_path: Path) -> None:
    """In order, once, and the gateway is online only behind it."""
    with site(tmp_path) as place, place.gateway() as program:
        status = HttpClient(said(program, "http://").strip())
        said(program, "mqtt: connected")
        for line in place.lines:
            line.wait_for_more(10)
        assert status.get("/api/status").json["mqtt"]["error"] is None
        place.mosquitto.kill()
        since = place.given()
        away(program)
        for line in place.lines:
            line.wait_for_more(60)
        told = status.get("/api/status").json["mqtt"]
        assert told["error"]
        assert told["waiting"] > 100
        assert told["hours"] > 1
        assert b"multidrop_mqtt_outbox_hours" in status.get("/metrics").body
        before = place.given()

        async def heard() -> None:
            async with back(place) as watching:
                await watching.until(STATUS, lambda said: said == "online")
                for line, least in zip(place.lines, before, strict=True):
                    assert numbers(watching, line)[-1] >= least  # before it said online
                    never_changed = json.loads(watching.seen[f"multidrop/{line.name}/feed"])
                    assert never_changed["value"] == 0  # which the broker had forgotten
                for line in place.lines:
                    await until_count(watching, line, len(line.given) + 10)
                all_in_order_and_once(watching, place, since)
                for line in place.lines:
                    topic = f"multidrop/{line.name}/count"
                    found = records(watching, topic)
                    assert found == sorted(set(found))

        asyncio.run(heard())
        said(program, "have followed")
        wait_until(lambda: status.get("/api/status").json["mqtt"]["waiting"] < 10)
        stop(program)


def test_a_gateway_that_is_killed_while_its_broker_is_away(tmp_path: Path) -> None:
    """What was put away is there, except at most the last second, and the next run goes on behind it."""
    with site(tmp_path) as place:
        with place.gateway() as program:
            said(program, "mqtt: connected")
            place.lines[0].wait_for_more(10)
            place.mosquitto.kill()
            since = place.given()
            away(program)
            place.lines[0].wait_for_more(60)
            program.end()
        killed = [line.given[-1] for line in place.lines]

        with place.gateway() as program:
            away(program)
            place.lines[0].wait_for_more(20)

            async def heard() -> None:
                async with back(place) as watching:
                    await watching.until(STATUS, lambda said: said == "online")
                    for line, first, last in zip(place.lines, since, killed, strict=True):
                        found = numbers(watching, line)
                        assert found == sorted(set(found))
                        assert found[0] <= first + 1
                        lost = set(range(found[0], found[-1] + 1)) - set(found)
                        assert all(
                            last.monotonic - line.given[number - 1].monotonic < 1.0
                            for number in lost
                        )
                        runs = records(watching, f"multidrop/{line.name}/count")
                        assert runs == sorted(runs)
                        assert len({run for run, _ in runs}) == 2

            asyncio.run(heard())
            stop(program)


def test_a_connection_that_breaks_in_the_middle_of_what_waited(tmp_path: Path) -> None:
    """What was not confirmed comes again; who goes by `record` has everything in order and once."""
    with cuttable(tmp_path) as (place, way), place.gateway() as program:
        said(program, "mqtt: connected")

        async def heard() -> None:
            async with watcher(place.mosquitto) as watching:
                await until_count(watching, place.lines[0], 10)
                for _ in range(2):
                    way.cut()
                    await asyncio.to_thread(place.lines[0].wait_for_more, 15)
                    way.join()
                    seen = len(watching.messages)
                    while len(watching.messages) < seen + 20:
                        watching.messages.append(await anext(aiter(watching.client.messages)))
                for line in place.lines:
                    await until_count(watching, line, len(line.given) + 10)
                for line in place.lines:
                    once_by_record(watching, line)

        asyncio.run(heard())
        stop(program)


def once_by_record(watching: Watcher, line: CountingLine) -> None:
    newest = (0, 0)
    found: list[int] = []
    for message in watching.messages:
        if str(message.topic) == f"multidrop/{line.name}/count":
            state = json.loads(message.payload)
            if "record" in state and tuple(state["record"]) > newest:
                newest = tuple(state["record"])
                if state["value"] is not None:
                    found.append(state["value"])
    assert found == list(range(found[0], found[-1] + 1))


def test_beyond_the_bound_a_gap_is_published_in_its_place(tmp_path: Path) -> None:
    with site(tmp_path, "outbox_size = 1") as place:
        place.mosquitto.kill()
        with place.gateway() as program:
            away(program)
            for line in place.lines:
                line.wait_for_more(20)
            stop(program)
        lost = blown_up(tmp_path / "mqtt-outbox.db")
        with place.gateway() as program:
            away(program)
            for line in place.lines:
                line.wait_for_more(40)

            async def heard() -> None:
                async with back(place) as watching:
                    await watching.until(STATUS, lambda said: said == "online")
                    messages = [m for m in watching.messages if str(m.topic) != STATUS]
                    assert str(messages[0].topic) == "multidrop/gap"
                    gap = json.loads(messages[0].payload)
                    assert gap["states"] == lost
                    assert gap["reason"] == "the outbox was full"
                    assert gap["from"] < gap["until"]
                    assert json.loads(messages[1].payload)["record"] == gap["before"]

            asyncio.run(heard())
            stop(program)


def blown_up(path: Path) -> int:
    """Make the oldest record of an outbox so large that it has no room beside others; its states."""
    with contextlib.closing(sqlite3.connect(path)) as file, file:
        oldest = "number = (SELECT min(number) FROM records)"
        file.execute(f"UPDATE records SET data = zeroblob(1000000) WHERE {oldest}")
        (states,) = file.execute(f"SELECT samples FROM records WHERE {oldest}").fetchone()
    return int(states)


def test_a_broker_need_not_wait_to_confirm(tmp_path: Path) -> None:
    """Else each lot of confirmations takes the 40 ms after which TCP acknowledges by itself."""

    async def quickest(port: int) -> float:
        took = []
        protocol = aiomqtt.ProtocolVersion.V5
        async with Client("127.0.0.1", port, protocol=protocol) as client:
            client.pending_calls_threshold = 100
            for _ in range(20):
                start = time.perf_counter()
                lot = [(f"m/{number}", "x" * 100, False) for number in range(AT_ONCE)]
                await publish_together(client, lot, 1)
                took.append(time.perf_counter() - start)
        return sorted(took)[len(took) // 4]

    with broker(tmp_path) as mosquitto:
        assert asyncio.run(quickest(mosquitto.port)) < 0.03


def test_no_command_waits(tmp_path: Path) -> None:
    """Neither in the outbox nor at the broker: a machine must not start because a broker came back."""
    with cuttable(tmp_path, "commands = true") as (place, way), place.gateway() as program:

        async def heard() -> None:
            async with watcher(place.mosquitto) as watching:
                await watching.until(STATUS, lambda said: said == "online")
                way.cut()
                await watching.until(STATUS, lambda said: said == "offline")
                await watching.command("7", "multidrop/line0/feed/set", expiry=10)
                await asyncio.to_thread(place.lines[0].wait_for_more, 20)
                way.join()
                await watching.until(STATUS, lambda said: said == "online")
                await asyncio.to_thread(place.lines[0].wait_for_more, 20)
                assert "answers/test" not in watching.seen
                assert json.loads(watching.seen["multidrop/line0/feed"])["value"] == 0

        asyncio.run(heard())
        stop(program)
