"""The whole gateway under load while its database server, or its broker, is killed and comes back."""

from __future__ import annotations

import asyncio
import json
import time
from contextlib import ExitStack
from pathlib import Path

from integration.counting import SOAK, CountingLine, all_is_kept, plant, stop, wait_until
from integration.gateways import Client
from integration.mosquitto import broker
from integration.postgres_server import postgres_server
from integration.processes import running
from integration.test_gateway_mqtt import Watcher, watcher

AWAY_FOR = 60.0 if SOAK else 2.0
LINES = 4


def test_a_database_server_that_is_killed(tmp_path: Path) -> None:
    """Everything waits in the outbox, follows in order, and nothing comes twice."""
    with ExitStack() as stack:
        server = stack.enter_context(postgres_server(tmp_path))
        lines = [CountingLine(f"line{number}") for number in range(LINES)]
        tables = f'[http]\nlisten = "127.0.0.1:0"\n[history]\ndsn = "{server.dsn}"\n'
        stack.enter_context(plant(tmp_path, tables, *lines))
        program = stack.enter_context(running("run", cwd=tmp_path))
        client = Client(program.wait_for("http://"))

        def history() -> dict[str, object]:
            found: dict[str, object] = client.get("/api/status").json["history"]
            return found

        lines[-1].wait_for_more(40)
        wait_until(lambda: history()["error"] is None and history()["hours"])
        server.kill()
        program.wait_for("history: ")
        time.sleep(AWAY_FOR)
        assert history()["error"]
        waiting = history()["waiting"]
        assert isinstance(waiting, int)
        assert waiting > AWAY_FOR * LINES  # each line has more than a sample a second
        server.start()
        program.wait_for("history: it is written again")
        lines[-1].wait_for_more(40)
        stop(program)
        all_is_kept(tmp_path, lines)


def test_a_broker_that_is_killed(tmp_path: Path) -> None:
    """History does not notice; who subscribes again hears the newest, and never an older one."""
    with ExitStack() as stack:
        mosquitto = stack.enter_context(broker(tmp_path))
        lines = [CountingLine(f"line{number}") for number in range(LINES)]
        tables = f'[history]\n[mqtt]\nhost = "127.0.0.1"\nport = {mosquitto.port}\n'
        stack.enter_context(plant(tmp_path, tables, *lines))
        program = stack.enter_context(running("run", cwd=tmp_path))
        program.wait_for("mqtt: connected")
        lines[-1].wait_for_more(20)
        mosquitto.kill()
        program.wait_for("is away")
        time.sleep(AWAY_FOR)
        before = [len(line.given) for line in lines]
        mosquitto.start()

        async def heard() -> dict[str, list[int | None]]:
            async with watcher(mosquitto) as watching:
                await asyncio.to_thread(wait_until, connected_again, 45.0)
                await watching.until("multidrop/status", lambda status: status == "online")
                for line in lines:
                    await some_of(watching, line)
                return {
                    line.name: [
                        json.loads(message.payload)["value"]
                        for message in watching.messages
                        if str(message.topic) == f"multidrop/{line.name}/count"
                    ]
                    for line in lines
                }

        def connected_again() -> bool:  # it tries every 30 s where a broker is away for long
            return sum("mqtt: connected" in text for text in program.out) > 1

        async def some_of(watching: Watcher, line: CountingLine) -> None:
            enough = len(line.given) + 10
            await watching.until(
                f"multidrop/{line.name}/count", lambda state: (state["value"] or 0) >= enough
            )

        found = asyncio.run(heard())
        stop(program)
        for line, least in zip(lines, before, strict=True):
            numbers = [number for number in found[line.name] if number is not None]
            assert numbers == sorted(set(numbers))
            assert numbers[0] >= least
        all_is_kept(tmp_path, lines)
