"""The Modbus TCP server: the plant's points as registers. docs/reference/modbus.md says how.

A value is given only while it is good. A write is answered when its outcome is known.

pymodbus reads and writes the messages. Its own server is not used: of requests that come
one right behind the other it loses some and answers others under a wrong number, and it
answers a write with what it reads afterwards.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from multidrop.errors import Error, NoReply, OutcomeUnknown, PortError, ProtocolError, UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.modbus.register_map import Entry, RegisterMap, keep_map, map_of
from multidrop.gateway.settings import Settings, demand_writable, objections
from multidrop.io.listen import Called, Caller, listen
from multidrop.io.ports import tcp_address
from multidrop.plant import Plant

try:
    from pymodbus.constants import ExcCodes
    from pymodbus.framer import FramerSocket
    from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
    from pymodbus.pdu import register_message as messages
except ImportError as missing:
    raise UsageError('[modbus] needs more: pip install "multidrop[modbus]"') from missing

if TYPE_CHECKING:
    from multidrop.gateway.settings import ModbusSettings

HEAD = 6
"""Bytes before a message's unit: its number, 0, the size of what follows."""

LONGEST = 254
"""Bytes of unit and message, by the Modbus specification."""

MOST_WAITING = 16
"""Requests of one client that may wait; one that sends more is cut off."""

MOST_CLIENTS = 64

SILENT = 300.0
"""s after which a client that says nothing makes room for another: it may have been unplugged."""

WRITE_WITHIN = 1.0
"""s after its receipt in which a write must begin: its client may have given it up since."""

REQUESTS: dict[int, type[ModbusPDU]] = {
    3: messages.ReadHoldingRegistersRequest,
    4: messages.ReadInputRegistersRequest,
    6: messages.WriteSingleRegisterRequest,
    16: messages.WriteMultipleRegistersRequest,
}
MOST_REGISTERS = {3: 125, 4: 125, 6: 1, 16: 123}


class Refused(Exception):
    """A request that is answered with an exception code."""

    def __init__(self, code: ExcCodes) -> None:
        super().__init__(code.name)
        self.code = code


@dataclass(frozen=True, slots=True)
class Request:
    """One message. `code` and `body` are its function and data, `received` is monotonic, s."""

    number: int
    unit: int
    code: int
    body: bytes
    received: float


def part(gateway: Gateway) -> ModbusServer:
    """The part of a gateway whose plant file has a `[modbus]`."""
    assert gateway.settings.modbus is not None
    return ModbusServer(gateway, gateway.settings.modbus)


def wrong(plant: Plant, settings: Settings) -> Iterator[str]:
    """What is wrong with `[modbus]`, and with the register map that it names."""
    table = settings.modbus
    assert table is not None
    path = settings.path(table.map)

    def listens() -> None:
        try:
            tcp_address(f"tcp://{table.listen}")
        except UsageError:
            raise UsageError(f"modbus.listen is {table.listen!r}, which is not HOST:PORT") from None

    for text in objections(lambda: map_of(plant, path)):
        yield from (f"modbus.map: {line}" for line in text.splitlines())
    yield from objections(listens, lambda: demand_writable("modbus.map", path))


class ModbusServer:
    """A part of the gateway."""

    name = "modbus"

    def __init__(self, gateway: Gateway, settings: ModbusSettings) -> None:
        self.gateway = gateway
        self.settings = settings
        self.clients: set[Client] = set()
        self._plant = gateway.plant
        self._map = self._keep_map()
        self.port = ""

    async def run(self) -> None:
        """Serve until cancelled. Raises `PortError` where it cannot listen."""
        listener = await listen(f"tcp://{self.settings.listen}", self._answer)
        self.port = listener.port.removeprefix("tcp://")
        self.gateway.say(f"modbus on {self.port}")
        if self.settings.writes and not listener.loopback:
            self.gateway.say(f"modbus: whoever reaches {self.port} may write: it has no passwords")
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            listener.close()
            for client in tuple(self.clients):
                client.hang_up()

    def _answer(self, caller: Caller) -> Called:
        client = Client(self, caller)
        if len(self.clients) > MOST_CLIENTS:
            oldest = min(self.clients, key=lambda each: each.heard)
            is_gone = client.heard - oldest.heard > SILENT
            (oldest if is_gone else client).hang_up()
        return client

    @property
    def map(self) -> RegisterMap:
        """Of the plant as it is now; a reload adds what is new."""
        if self._plant is not self.gateway.plant:
            self._plant = self.gateway.plant
            try:
                self._map = self._keep_map()
            except (UsageError, PortError) as error:
                self.gateway.say(f"modbus: new points have no registers: {error}")
        return self._map

    def _keep_map(self) -> RegisterMap:
        return keep_map(self._plant, self.gateway.settings.path(self.settings.map))

    # -- requests ----------------------------------------------------------------------------

    async def execute(self, request: Request, client: str) -> ModbusPDU:
        """Carry out a request, whatever it says."""
        try:
            message = _decoded(request)
            if request.code in (3, 4):
                return self._read(request.code, message)
            return await self._write(request, message, client)
        except Refused as refused:
            return ExceptionResponse(request.code, refused.code)

    def _entries(self, message: ModbusPDU, count: int) -> list[Entry]:
        """The points of these registers. What is half a point, or no point of this plant, is refused."""
        entries = self.map.covering(message.address, count)
        if entries is None:
            raise Refused(ExcCodes.ILLEGAL_ADDRESS)
        for entry in entries:
            device = self._plant.devices.get(entry.device)
            if device is None or entry.point not in device.points:
                raise Refused(ExcCodes.ILLEGAL_ADDRESS)
        return entries

    def _read(self, code: int, message: ModbusPDU) -> ModbusPDU:
        registers: list[int] = []
        for entry in self._entries(message, message.count):
            update = self.gateway.values.get(entry.device, entry.point)
            if update is None or not update.good or update.value is None:
                raise Refused(ExcCodes.GATEWAY_NO_RESPONSE)
            try:
                registers += entry.type.to_registers(update.value)
            except ValueError:
                raise Refused(ExcCodes.DEVICE_FAILURE) from None
        if code == 3:
            return messages.ReadHoldingRegistersResponse(registers=registers)
        return messages.ReadInputRegistersResponse(registers=registers)

    async def _write(self, request: Request, message: ModbusPDU, client: str) -> ModbusPDU:
        """One point, whole: Modbus could not say which of several was written."""
        registers = list(message.registers)
        entries = self._entries(message, len(registers))
        if len(entries) != 1:
            raise Refused(ExcCodes.ILLEGAL_ADDRESS)
        entry = entries[0]
        value = entry.type.from_registers(registers)
        asked = (entry.device, entry.point, value)
        told = {"who": "modbus client", "origin": f"modbus {client}"}
        late = asyncio.get_running_loop().time() - request.received
        if not self.settings.writes:
            self.gateway.refuse(*asked, "[modbus] has no writes = true", **told)
            raise Refused(ExcCodes.ILLEGAL_FUNCTION)
        if late > WRITE_WITHIN:
            self.gateway.refuse(*asked, f"it has waited here for {late:.1f} s", **told)
            raise Refused(ExcCodes.DEVICE_BUSY)
        try:
            await self.gateway.write(*asked, **told)
        except Error as error:
            raise Refused(self._code(entry, error)) from None
        return _echo(request.code, message)

    def _code(self, entry: Entry, error: Error) -> ExcCodes:
        """What a client is told of a write that was not confirmed."""
        if isinstance(error, UsageError):
            device = self._plant.devices.get(entry.device)  # a reload may have taken it away
            known = None if device is None else device.points.get(entry.point)
            writable = known is not None and known.write is not None
            return ExcCodes.ILLEGAL_VALUE if writable else ExcCodes.ILLEGAL_ADDRESS
        if isinstance(error, NoReply | PortError | ProtocolError | OutcomeUnknown):
            return ExcCodes.GATEWAY_NO_RESPONSE
        return ExcCodes.DEVICE_FAILURE


class Client:
    """One connection: its requests are carried out one after the other."""

    def __init__(self, server: ModbusServer, caller: Caller) -> None:
        self._server = server
        self._caller = caller
        self._framer = FramerSocket(DecodePDU(True))
        self._buffer = bytearray()
        self._waiting: asyncio.Queue[Request] = asyncio.Queue(MOST_WAITING)
        self.heard = asyncio.get_running_loop().time()
        server.clients.add(self)
        self._working = asyncio.create_task(self._work())

    def receive(self, data: bytes) -> None:
        self.heard = asyncio.get_running_loop().time()
        self._buffer += data
        try:
            while (request := self._next()) is not None:
                self._waiting.put_nowait(request)
        except (ValueError, asyncio.QueueFull):
            self.hang_up()

    def _next(self) -> Request | None:
        """The first whole request. Raises `ValueError` where no beginning can be found any more."""
        if len(self._buffer) < HEAD:
            return None
        number, protocol, size = struct.unpack(">HHH", self._buffer[:HEAD])
        if protocol or not 2 <= size <= LONGEST:
            raise ValueError("not Modbus")
        if len(self._buffer) < HEAD + size:
            return None
        unit, code, *_ = self._buffer[HEAD:]
        body = bytes(self._buffer[HEAD + 2 : HEAD + size])
        del self._buffer[: HEAD + size]
        return Request(number, unit, code, body, asyncio.get_running_loop().time())

    async def _work(self) -> None:
        """Until cancelled; a client must not wait for one that has failed."""
        try:
            while True:
                request = await self._waiting.get()
                answer = await self._server.execute(request, self._caller.name)
                answer.transaction_id, answer.dev_id = request.number, request.unit
                self._caller.write(self._framer.buildFrame(answer))
        finally:
            self._caller.hang_up()

    def hang_up(self) -> None:
        self._caller.hang_up()
        self.close()

    def close(self) -> None:
        """The client has gone: what it still wanted is not begun."""
        self._working.cancel()
        self._server.clients.discard(self)


def _decoded(request: Request) -> ModbusPDU:
    """Raises `Refused` for what is not offered, and what is not well formed."""
    if request.code not in REQUESTS:
        raise Refused(ExcCodes.ILLEGAL_FUNCTION)
    message = REQUESTS[request.code]()
    try:
        message.decode(request.body)
    except (ValueError, IndexError, struct.error):
        raise Refused(ExcCodes.ILLEGAL_VALUE) from None
    if request.code == 16:
        size, count = 5 + 2 * message.count, message.count
        right = len(request.body) == size and request.body[4] == 2 * count
    else:
        count = message.count if request.code != 6 else 1
        right = len(request.body) == 4
    if not right or not 1 <= count <= MOST_REGISTERS[request.code]:
        raise Refused(ExcCodes.ILLEGAL_VALUE)
    return message


def _echo(code: int, message: ModbusPDU) -> ModbusPDU:
    """The answer to a write that was done."""
    if code == 6:
        return messages.WriteSingleRegisterResponse(
            address=message.address, registers=message.registers
        )
    return messages.WriteMultipleRegistersResponse(address=message.address, count=message.count)
