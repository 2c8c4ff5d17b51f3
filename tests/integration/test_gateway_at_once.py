"""What is small is sent at once: not 40 ms later, when the other side's system acknowledges what came before."""

from __future__ import annotations

import asyncio
import socket
import time
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from integration.mosquitto import broker
from integration.servers import serving
from multidrop.gateway.mqtt.broker import Broker
from multidrop.gateway.settings import MqttSettings
from multidrop.gateway.web.access import Place
from multidrop.gateway.web.server import bound


def at_once(sock: Any) -> bool:
    return bool(sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))


def test_the_server_of_the_page_keeps_no_event_back() -> None:
    async def main() -> bool:
        called: asyncio.Future[bool] = asyncio.get_running_loop().create_future()

        async def call(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            called.set_result(at_once(writer.get_extra_info("socket")))
            writer.close()

        with bound(Place("127.0.0.1", 0)) as listening:
            async with await asyncio.start_server(call, sock=listening):
                _, writer = await asyncio.open_connection(*listening.getsockname())
                found = await called
                writer.close()
                await writer.wait_closed()
        return found

    assert asyncio.run(main())


def test_no_state_is_kept_back(tmp_path: Path) -> None:
    async def main(port: int) -> bool:
        client: Any = Broker(MqttSettings("127.0.0.1", port), Path).client("status")
        async with client:
            return at_once(client._client.socket())

    with broker(tmp_path) as mosquitto:
        assert asyncio.run(main(mosquitto.port))


def test_a_broker_that_hangs_up_at_once_is_away_at_once(tmp_path: Path) -> None:
    """As where something stands before it that takes every call: that must not cost ten seconds each time."""

    async def main(port: int) -> None:
        start = time.monotonic()
        with pytest.raises(aiomqtt.MqttError, match="hung up before it answered"):
            async with Broker(MqttSettings("127.0.0.1", port), Path).client("status"):
                pass
        assert time.monotonic() - start < 3

    with serving(lambda connected: None) as server:
        asyncio.run(main(int(server.port.rpartition(":")[2])))
