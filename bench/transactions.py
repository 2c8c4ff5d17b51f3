"""Read transactions over loopback TCP, master and slave in one asyncio loop.

Each contestant runs in a process of its own: `python -m bench.transactions NAME COUNT`
prints its transactions a second, once a first connection was opened and closed in it.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable
from dataclasses import replace
from statistics import median
from time import process_time
from typing import Any

from bench.measure import Result, line_of, ratio, start
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Format, Frame, Master, Slave

HOST = "127.0.0.1"
INDEX, VALUE = 8236, 513
QUESTION = Frame(1, 0, 0, 0x26, bytes((3, 0x2C, 0x20))).encode()  # 11 bytes
ANSWER = Frame(1, 0, 1, 0, bytes((3, 0x2C, 0x20, 1, 2))).encode()  # 13 bytes
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
        self._slave = Slave(1)
        self._buffer = bytearray(4096)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.WriteTransport)
        self._transport = transport

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        for request in self._slave.receive_data(bytes(self._buffer[:nbytes])):
            reply = request.settled or request.found(Format.SHORT_INT, b"\x01\x02")
            self._transport.write(self._slave.answer(request, reply))


async def multidrop(count: int) -> float:
    from multidrop.io.async_line import open_async_line

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
NAMES = {
    "multidrop": "multidrop",
    "streams": "streams",
    "bare": "bare protocols",
    "bare_with_timeout": "bare protocols with a time-out pending",
    "rtu": "pymodbus RTU",
    "socket": "pymodbus TCP",
}


# -- the row ----------------------------------------------------------------------------------


def transactions(quick: bool) -> list[Result]:
    """Each contestant in a process of its own, one after the other, in several rounds.

    The row compares with pymodbus' faster framer.
    """
    count = 1000 if quick else 3000
    rates: dict[str, list[float]] = {name: [] for name in CONTESTANTS}
    for _ in range(3 if quick else 9):
        for name, found in rates.items():
            process = start("transactions", name, str(count))
            found.append(float(line_of(process.stdout)))
            process.communicate()
    ours = rates["multidrop"]
    faster = max(("rtu", "socket"), key=lambda name: median(rates[name]))
    to_pymodbus = ratio(ours, rates[faster])
    to_streams = ratio(ours, rates["streams"])
    figures = ", ".join(f"{NAMES[name]} {median(rates[name]):,.0f}" for name in rates)
    return [
        Result(
            "read transactions over loopback TCP, one asyncio loop",
            "pymodbus; asyncio streams as the limit",
            ">= 2.5 and >= 0.8",
            f"{to_pymodbus:.2f} and {to_streams:.2f}",
            to_pymodbus >= 2.5 and to_streams >= 0.8,
            [f"a second: {figures}"],
        )
    ]


async def _contest(name: str, count: int) -> float:
    return await CONTESTANTS[name](count)


if __name__ == "__main__":
    contestant, number = sys.argv[1], int(sys.argv[2])
    asyncio.run(_contest(contestant, 1))  # from here on the C library keeps asyncio's buffers
    print(asyncio.run(_contest(contestant, number)))
