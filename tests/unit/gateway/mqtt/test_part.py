"""The MQTT part ends when it is told to, also where a cancellation is swallowed on its way."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import pytest

from multidrop.gateway.mqtt.broker import Client, end_all, end_if_cancelled


async def _swallows_one() -> None:
    """As `asyncio.wait_for` before Python 3.12, whose future was done in the same moment."""
    try:
        await asyncio.Event().wait()
    except asyncio.CancelledError:
        await asyncio.Event().wait()


def test_a_task_that_swallows_a_cancellation_ends_nevertheless() -> None:
    async def end() -> asyncio.Task[None]:
        task = asyncio.create_task(_swallows_one())
        await asyncio.sleep(0)
        async with asyncio.timeout(10):
            await end_all([task])
        return task

    assert asyncio.run(end()).cancelled()


def test_what_a_task_raised_is_no_failure_of_ending_it() -> None:
    async def fails() -> None:
        raise ValueError

    async def end() -> None:
        await end_all([asyncio.create_task(fails())])

    asyncio.run(end())


def test_a_connection_that_is_no_longer_wanted_is_not_used() -> None:
    async def connects() -> None:
        end_if_cancelled()
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            end_if_cancelled()
        raise AssertionError("went on")

    async def cancel() -> None:
        task = asyncio.create_task(connects())
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(cancel())


def test_a_socket_that_is_closed_before_it_is_watched_is_no_error() -> None:
    """A write that is the first to notice that the broker has gone closes it."""
    complaints: list[dict[str, Any]] = []

    async def publish() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda loop, context: complaints.append(context))
        client = Client("127.0.0.1")
        assert client._client.on_socket_register_write == client._on_socket_register_write
        with socket.socket() as sock:
            client._on_socket_register_write(client._client, None, sock)
        await asyncio.sleep(0)
        await asyncio.sleep(0)

    asyncio.run(publish())
    assert complaints == []
