"""Those who are measured in the row `transactions`: `python -m bench.contestants NAME COUNT [behind]`.

Prints how many transactions a second NAME does in this process: as a new one, or `behind` a
first connection that was opened and closed in it. Each imports only what it needs, since what
a program has imported decides how the C library deals with asyncio's buffers.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable
from time import process_time
from typing import Any

HOST = "127.0.0.1"
INDEX, VALUE = 8236, 513
QUESTION = bytes.fromhex("01 01 00 0B 00 26 00 03 2C 20 23")
ANSWER = bytes.fromhex("01 01 00 0D 01 00 00 03 2C 20 01 02 01")
WARM_UP = 300

Transaction = Callable[[], Awaitable[Any]]


async def rate(transaction: Transaction, count: int) -> float:
    """Transactions a second, one after the other: of processor time, for there is nothing to wait for."""
    for _ in range(WARM_UP):
        await transaction()
    started = process_time()
    for _ in range(count):
        await transaction()
    return count / (process_time() - started)


# -- multidrop --------------------------------------------------------------------------------


class SlaveProtocol(asyncio.BufferedProtocol):
    """A SLINK3 slave with one parameter on a TCP port."""

    def __init__(self) -> None:
        from multidrop.protocols.slink3 import Format, Slave

        self._slave = Slave(1)
        self._format = Format.SHORT_INT
        self._buffer = bytearray(4096)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.WriteTransport)
        self._transport = transport

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        for request in self._slave.receive_data(bytes(self._buffer[:nbytes])):
            reply = request.settled or request.found(self._format, b"\x01\x02")
            self._transport.write(self._slave.answer(request, reply))


async def multidrop(count: int) -> float:
    from dataclasses import replace

    from multidrop.io.async_line import open_async_line
    from multidrop.protocols import slink3
    from multidrop.protocols.slink3 import Format, Master

    server = await asyncio.get_running_loop().create_server(SlaveProtocol, HOST, 0)
    port = f"tcp://{HOST}:{server.sockets[0].getsockname()[1]}"
    master = Master(1)
    async with await open_async_line(port, replace(slink3.LINE, gap=0.0)) as line:

        async def read() -> None:
            found = await line.run(master.read_typed(INDEX, Format.SHORT_INT))
            assert found.value == VALUE

        found = await rate(read, count)
    server.close()
    return found


# -- the limits -------------------------------------------------------------------------------


async def streams(count: int) -> float:
    """asyncio streams that know no protocol: 11 bytes out, 13 bytes back."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                await reader.readexactly(len(QUESTION))
                writer.write(ANSWER)
        except asyncio.IncompleteReadError:
            writer.close()

    server = await asyncio.start_server(serve, HOST, 0)
    reader, writer = await asyncio.open_connection(HOST, server.sockets[0].getsockname()[1])

    async def read() -> None:
        writer.write(QUESTION)
        await reader.readexactly(len(ANSWER))

    found = await rate(read, count)
    writer.close()
    await asyncio.sleep(0.05)  # the other side sees the end
    server.close()
    return found


class BareSlave(asyncio.Protocol):
    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.WriteTransport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        self._transport.write(ANSWER)


class BareMaster(asyncio.Protocol):
    answered: asyncio.Future[None]

    def data_received(self, data: bytes) -> None:
        self.answered.set_result(None)


async def bare(count: int) -> float:
    """asyncio protocols that look at no byte."""
    loop = asyncio.get_running_loop()
    server = await loop.create_server(BareSlave, HOST, 0)
    number = server.sockets[0].getsockname()[1]
    transport, master = await loop.create_connection(BareMaster, HOST, number)

    async def read() -> None:
        master.answered = loop.create_future()
        transport.write(QUESTION)
        await master.answered

    found = await rate(read, count)
    transport.close()
    await asyncio.sleep(0.05)
    server.close()
    return found


async def bare_with_timeout(count: int) -> float:
    """The same while a time-out is pending, as it always is for whoever does not wait forever."""
    timer = asyncio.get_running_loop().call_later(3600.0, lambda: None)
    try:
        return await bare(count)
    finally:
        timer.cancel()


# -- pymodbus ---------------------------------------------------------------------------------


async def pymodbus(count: int, framer_name: str) -> float:
    """pymodbus' client and server; a read of one register is its 16-bit read."""
    from pymodbus import FramerType
    from pymodbus.client import AsyncModbusTcpClient
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    framer = FramerType(framer_name)
    registers = SimData(INDEX, values=VALUE, datatype=DataType.REGISTERS)
    server = ModbusTcpServer(SimDevice(1, [registers]), framer=framer, address=(HOST, 0))
    await server.serve_forever(background=True)
    assert isinstance(server.transport, asyncio.Server)
    port = server.transport.sockets[0].getsockname()[1]
    client = AsyncModbusTcpClient(HOST, port=port, framer=framer)
    await client.connect()

    async def read() -> None:
        found = await client.read_holding_registers(INDEX, count=1, device_id=1)
        assert found.registers == [VALUE]

    found = await rate(read, count)
    client.close()
    await asyncio.sleep(0.05)
    stop: Any = server.shutdown  # untyped
    await stop()
    return found


CONTESTANTS: dict[str, Callable[[int], Awaitable[float]]] = {
    "multidrop": multidrop,
    "streams": streams,
    "bare": bare,
    "bare_with_timeout": bare_with_timeout,
    "rtu": lambda count: pymodbus(count, "rtu"),
    "socket": lambda count: pymodbus(count, "socket"),
}


async def contest(name: str, count: int) -> float:
    return await CONTESTANTS[name](count)


if __name__ == "__main__":
    contestant, number, *behind = sys.argv[1:]
    if behind:
        asyncio.run(contest(contestant, 1))  # from here on the C library keeps asyncio's buffers
    print(asyncio.run(contest(contestant, int(number))))
