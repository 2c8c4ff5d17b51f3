"""Answers that a device server hands over byte by byte, and what of them is left with the system."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from integration.servers import Connected, reply_to, serving
from multidrop.errors import NoReply, PortError
from multidrop.io.async_line import AsyncLine, open_async_line
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import AX_V, Format, Frame, Master

QUICK = replace(slink3.LINE, timeout=0.5, silence=0.1, attempts=1)
AX = Master(2, AX_V)
VALUE = b"\x03\xf1\x03\x7d\x00"  # short int, IPA 1009, 125


def value(request: Frame) -> bytes:
    return reply_to(request, 0, VALUE).encode()


def byte_by_byte(line: Connected, data: bytes) -> None:
    for byte in data:
        line.send(bytes([byte]))
        line.pause(0.002)


def on_line(
    then: Callable[[Connected, bytes], None],
    main: Callable[[AsyncLine, list[bytes]], Awaitable[None]],
) -> None:
    """`main(line, pieces heard)`, on a server that answers byte by byte, and at last as `then` says."""

    def behave(line: Connected) -> None:
        for number, request in enumerate(line.requests()):
            (byte_by_byte if number < 2 else then)(line, value(request))

    async def go(port: str) -> None:
        async with await open_async_line(port, QUICK) as line:
            heard: list[bytes] = []
            line.taps.append(lambda data, sent, *_: None if sent else heard.append(data))
            await main(line, heard)

    with serving(behave) as server:
        asyncio.run(go(server.port))


async def read(line: AsyncLine) -> int:
    found = await line.run(AX.read_typed(1009, Format.SHORT_INT))
    assert isinstance(found.value, int)
    return found.value


async def learn(line: AsyncLine, heard: list[bytes]) -> None:
    assert await read(line) == 125
    assert len(heard) > 3
    heard.clear()


def test_an_answer_that_comes_byte_by_byte_is_heard_in_two_pieces_once_that_is_known() -> None:
    async def main(line: AsyncLine, heard: list[bytes]) -> None:
        await learn(line, heard)
        assert await read(line) == 125
        assert len(heard) <= 2
        assert len(heard[0]) >= 8

    on_line(byte_by_byte, main)


def test_an_answer_that_is_cut_short_is_heard_all_the_same() -> None:
    async def main(line: AsyncLine, heard: list[bytes]) -> None:
        await learn(line, heard)
        await read(line)
        with pytest.raises(NoReply) as raised:
            await read(line)
        assert raised.value.damaged == (heard[-1],)
        assert len(heard[-1]) == 5

    on_line(lambda line, answer: line.send(answer[:5]), main)


def test_an_answer_behind_a_few_bytes_of_noise_is_believed() -> None:
    async def main(line: AsyncLine, heard: list[bytes]) -> None:
        await learn(line, heard)
        await read(line)
        assert await read(line) == 125
        assert line.counters.damaged == 1

    on_line(lambda line, answer: byte_by_byte(line, b"\x55\xaa" + answer), main)


def test_what_comes_while_nobody_asks_is_heard_byte_by_byte() -> None:
    def then(line: Connected, answer: bytes) -> None:
        line.send(answer)
        line.pause(0.1)
        line.send(b"\x55")

    async def main(line: AsyncLine, heard: list[bytes]) -> None:
        await learn(line, heard)
        await read(line)
        await read(line)
        until = time.monotonic() + 10.0
        while heard[-1] != b"\x55" and time.monotonic() < until:
            await asyncio.sleep(0.01)
        assert heard[-1] == b"\x55"

    on_line(then, main)


def test_a_connection_that_ends_behind_half_an_answer_is_lost_at_once() -> None:
    def then(line: Connected, answer: bytes) -> None:
        line.send(answer[:5])
        line.connection.close()

    async def main(line: AsyncLine, heard: list[bytes]) -> None:
        await learn(line, heard)
        await read(line)
        with pytest.raises(PortError, match="the other side closed the connection"):
            await read(line)

    on_line(then, main)
