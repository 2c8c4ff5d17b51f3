"""Simulated lines where programs can reach them: TCP ports and pseudo-terminals."""

from __future__ import annotations

import asyncio
import os
import time
from pathlib import Path

import pytest

from multidrop.errors import PortError, UsageError
from multidrop.io.listen import Listener, PtyListener
from multidrop.protocols.slink3 import Frame
from multidrop.sim.line import Pace
from multidrop.sim.serve import serve
from unit.sim.wires import simulated

READ = Frame(2, 0, 0, 0x26, b"\x03\xf1\x03").encode()
ANSWER = bytes.fromhex("01 02 00 0D 01 00 00 03 F1 03 7D 00 82")


async def asked(listener: Listener, request: bytes = READ) -> bytes:
    host, number = listener.port.removeprefix("tcp://").rsplit(":", 1)
    reader, writer = await asyncio.open_connection(host.strip("[]"), int(number))
    try:
        writer.write(request)
        return await asyncio.wait_for(reader.readexactly(13), 5)
    finally:
        writer.close()
        await writer.wait_closed()


def test_any_free_port() -> None:
    async def serve_two() -> None:
        listeners = [await serve(simulated(), "tcp://127.0.0.1:0") for _ in range(2)]
        assert len({listener.port for listener in listeners}) == 2
        for listener in listeners:
            assert await asked(listener) == ANSWER
            listener.close()

    asyncio.run(serve_two())


def test_ipv6() -> None:
    async def serve_six() -> None:
        listener = await serve(simulated(), "tcp://[::1]:0")
        assert listener.port.startswith("tcp://[::1]:")
        assert await asked(listener) == ANSWER
        listener.close()

    asyncio.run(serve_six())


def test_many_clients_at_once_and_one_after_the_other() -> None:
    async def serve_many() -> None:
        listener = await serve(simulated(), "tcp://127.0.0.1:0")
        for _ in range(3):
            assert await asyncio.gather(*(asked(listener) for _ in range(20))) == [ANSWER] * 20
        listener.close()

    asyncio.run(serve_many())


@pytest.mark.parametrize("spin", [False, True])
def test_a_paced_answer_takes_its_time(spin: bool) -> None:
    async def serve_paced() -> float:
        listener = await serve(simulated(pace=Pace(11 / 9600)), "tcp://127.0.0.1:0", spin=spin)
        started = time.monotonic()
        assert await asked(listener) == ANSWER
        listener.close()
        return time.monotonic() - started

    assert asyncio.run(serve_paced()) >= 24 * 11 / 9600


def test_a_client_that_goes_in_the_middle() -> None:
    """What is due for it is not sent any more; the others do not notice."""

    async def leave() -> None:
        listener = await serve(simulated(pace=Pace(11 / 9600)), "tcp://127.0.0.1:0")
        host, number = listener.port.removeprefix("tcp://").split(":")
        _, writer = await asyncio.open_connection(host, int(number))
        writer.write(READ)
        writer.close()
        await writer.wait_closed()
        assert await asked(listener) == ANSWER
        listener.close()

    asyncio.run(leave())


def test_a_port_that_is_taken() -> None:
    async def serve_twice() -> None:
        listener = await serve(simulated(), "tcp://127.0.0.1:0")
        with pytest.raises(PortError, match=f"cannot listen on {listener.port}: "):
            await serve(simulated(), listener.port)
        listener.close()

    asyncio.run(serve_twice())


@pytest.mark.parametrize("where", ["127.0.0.1:4001", "udp://127.0.0.1:1", "ptyx", "", "tcp://h"])
def test_where_nobody_can_listen(where: str) -> None:
    with pytest.raises(UsageError, match="tcp://"):
        asyncio.run(serve(simulated(), where))


def test_a_pseudo_terminal_with_its_link(tmp_path: Path) -> None:
    async def serve_pty() -> None:
        link = tmp_path / "drive"
        listener = await serve(simulated(), f"pty:{link}")
        assert listener.port == str(link)
        assert await through(link) == ANSWER
        assert await through(link) == ANSWER  # programs may come and go
        listener.close()
        assert not os.path.lexists(link)

    asyncio.run(serve_pty())


def test_a_pseudo_terminal_without_a_link() -> None:
    async def serve_pty() -> None:
        listener = await serve(simulated(), "pty")
        assert listener.port.startswith("/dev/")
        assert await through(Path(listener.port)) == ANSWER
        listener.close()

    asyncio.run(serve_pty())


async def through(port: Path) -> bytes:
    """Ask through a terminal that some program opened; raw mode is the listener's."""
    loop = asyncio.get_running_loop()
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    found = bytearray()
    whole = asyncio.Event()

    def read() -> None:
        found.extend(os.read(fd, 100))
        if len(found) == len(ANSWER):
            whole.set()

    loop.add_reader(fd, read)
    try:
        os.write(fd, READ)
        await asyncio.wait_for(whole.wait(), 5)
    finally:
        loop.remove_reader(fd)
        os.close(fd)
    return bytes(found)


def test_nobody_reads_a_pseudo_terminal() -> None:
    """The bytes are lost, as on a wire; nothing blocks, and later answers come."""

    async def flood() -> None:
        listener = await serve(simulated(), "pty")
        assert isinstance(listener, PtyListener)
        for _ in range(2000):
            listener.write(bytes(100))
        listener.close()

    asyncio.run(asyncio.wait_for(flood(), 5))


def test_a_link_that_cannot_be_made(tmp_path: Path) -> None:
    async def serve_pty() -> None:
        with pytest.raises(PortError, match=r"cannot make .*nowhere/drive: No such file"):
            await serve(simulated(), f"pty:{tmp_path}/nowhere/drive")

    before = len(os.listdir("/dev/fd"))
    asyncio.run(serve_pty())
    assert len(os.listdir("/dev/fd")) == before


def test_a_link_to_what_is_there_stays(tmp_path: Path) -> None:
    link = tmp_path / "drive"
    link.symlink_to(tmp_path)

    async def serve_pty() -> None:
        with pytest.raises(PortError, match="File exists"):
            await serve(simulated(), f"pty:{link}")

    asyncio.run(serve_pty())
    assert link.resolve() == tmp_path


def test_a_link_that_leads_nowhere_is_replaced(tmp_path: Path) -> None:
    link = tmp_path / "drive"
    link.symlink_to("/dev/pts/99999")

    async def serve_pty() -> None:
        listener = await serve(simulated(), f"pty:{link}")
        assert await through(link) == ANSWER
        listener.close()

    asyncio.run(serve_pty())
