"""An asyncio line: the same conversations, many lines in one loop."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Hashable
from types import TracebackType
from typing import Any, Self, TypeVar

from multidrop.conversation import Conversation
from multidrop.errors import Error, PortError
from multidrop.exchange import Exchange
from multidrop.io.line import Tap, Timed, new_session
from multidrop.io.low_water import LowWater
from multidrop.io.parity import ParityMarks
from multidrop.io.ports import (
    CONNECT_TIMEOUT,
    RFC2217,
    PortSetup,
    lost,
    port_error,
    prepare,
    refuse_kernel,
    tcp_address,
)
from multidrop.io.turns import Priority, Turns
from multidrop.naming import LineOptions
from multidrop.session import Counters, Delays
from multidrop.timing import LineSettings

ResultT = TypeVar("ResultT")


SWALLOWED = 10_000
"""ms: a connection whose bytes nobody acknowledges for so long is lost (a network that drops all)."""

BUFFER = 4096
"""Bytes of a read: without a buffer of its own a line costs asyncio 256 KiB for every read."""


class AsyncLine(asyncio.BufferedProtocol, asyncio.Protocol):
    """One wire with one master. Any number of tasks may `run`; each gets its turn.

    Sockets fill its buffer, serial transports bring their own bytes.
    """

    def __init__(
        self,
        settings: LineSettings,
        options: LineOptions | None = None,
        *,
        network: bool = True,
        name: str = "the port",
    ) -> None:
        self.settings = settings
        self.name = name
        self.taps: list[Tap] = []
        self.acted = False  # whether the last exchange sent more than reads
        self.marks: ParityMarks | None = None
        self.low_water: LowWater | None = None
        self._session = new_session(settings, options or LineOptions(), network=network)
        self._loop = asyncio.get_running_loop()
        self._now = self._loop.time
        self._buffer = bytearray(BUFFER)
        self.turns = Turns()
        self._transport: asyncio.WriteTransport | None = None
        self._gone = asyncio.Event()
        self.lost: PortError | None = None  # why nothing can be asked any more
        self.on_lost: Callable[[], None] | None = None
        self._exchange: Exchange[Any, Any] | None = None
        self._finished: asyncio.Future[None] | None = None
        self._timers: list[asyncio.TimerHandle] = []  # the earliest last

    @property
    def counters(self) -> Counters:
        return self._session.counters

    @property
    def delays(self) -> Delays:
        """How long after its echo each Datalink Acknowledge was written."""
        return self._session.delays

    async def run(
        self,
        conversation: Conversation[Any, ResultT],
        priority: Priority = Priority.OPERATOR,
        device: Hashable = None,
    ) -> ResultT:
        """Carry out a conversation; returns what it returns, raises what it raises, or `PortError`.

        `device` is whom it is with, usually an address: within a priority devices take turns.
        """
        return (await self._carry_out(conversation, priority, device)).result()

    async def timed(
        self,
        conversation: Conversation[Any, ResultT],
        priority: Priority = Priority.OPERATOR,
        device: Hashable = None,
    ) -> Timed[ResultT]:
        """The same with the time of the last answer."""
        exchange = await self._carry_out(conversation, priority, device)
        result = exchange.result()
        received_at = exchange.received_at if exchange.received_at is not None else self._now()
        return Timed(result, received_at, received_at - exchange.asked_at)

    async def _carry_out(
        self, conversation: Conversation[Any, ResultT], priority: Priority, device: Hashable
    ) -> Exchange[Any, ResultT]:
        """The exchange when it is done, in its turn."""
        exchange = Exchange(conversation, self._session)
        try:
            if not self.turns.take():
                await self.turns.wait(priority, device)
            try:
                if self.lost is not None:
                    raise self.lost
                self._exchange = exchange
                self._finished = self._loop.create_future()
                self._send(exchange, exchange.start(self._now()))
                await self._finished
            except BaseException:
                exchange.abandon(self._now())
                raise
            finally:
                self._exchange = None
                if self.low_water is not None and self.low_water.used:
                    self.low_water.wait_for(1)
                self.turns.release()
        finally:
            self.acted = exchange.acted
        return exchange

    # -- what the loop calls -----------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport  # type: ignore[assignment]

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self.data_received(bytes(self._buffer[:nbytes]))

    def data_received(self, data: bytes) -> None:
        now = self._now()
        if self.low_water is not None:
            self.low_water.heard()
        pieces = ((data, False),) if self.marks is None else self.marks.split(data)
        for piece, damaged in pieces:
            for tap in self.taps:
                tap(piece, False, now, damaged)
            exchange = self._exchange
            if exchange is None or exchange.done:
                self._session.drain(piece, now, damaged=damaged)
            else:
                self._send(exchange, exchange.advance(piece, now, damaged=damaged))

    def connection_lost(self, error: Exception | None) -> None:
        self._gone.set()
        self.low_water = None
        self._break(error or "the other side closed the connection")

    def _break(self, why: str | BaseException) -> None:
        """The port was lost: whoever waits hears of it, and whoever asks from now on."""
        if self.lost is None:
            self.lost = lost(self.name, why)
            if self.on_lost is not None:
                self.on_lost()
        if self._finished is not None and not self._finished.done():
            self._finished.set_exception(self.lost)

    # -- sending and waiting -----------------------------------------------------------------

    def _send(self, exchange: Exchange[Any, Any], to_send: bytes) -> None:
        if to_send:
            assert self._transport is not None
            try:
                self._transport.write(to_send)
            except Exception as error:  # serialx raises what the platform raised
                self._break(error)
                return
            if exchange.told is not None:
                exchange.written(self._now())
            for tap in self.taps:
                tap(to_send, True, exchange.asked_at, False)
            if self.low_water is not None:
                self.low_water.asked()
        if not exchange.done:
            self._arm(exchange)
        elif self._finished is not None and not self._finished.done():
            self._finished.set_result(None)

    def _arm(self, exchange: Exchange[Any, Any]) -> None:
        """Wake at the deadline or before it: a timer that is set already is left to fire too early."""
        deadline, low_water = exchange.deadline, self.low_water
        if low_water is not None and low_water.used and low_water.wait_for(exchange.wants):
            deadline = min(deadline, self._now() + self._session.timing.silence)
        if not self._timers or deadline < self._timers[-1].when():
            self._timers.append(self._loop.call_at(deadline, self._time_passed))

    def _time_passed(self) -> None:
        self._timers.pop()
        exchange = self._exchange
        if exchange is None or exchange.done:
            return
        left = self.low_water.look(BUFFER) if self.low_water is not None else b""
        if left:
            self.data_received(left)
        else:
            self._send(exchange, exchange.advance(b"", self._now()))

    async def close(self) -> None:
        """Close the port and wait until it is free; whoever waits for an answer gets `PortError`."""
        for timer in self._timers:
            timer.cancel()
        if self.lost is None:
            self.lost = PortError(f"{self.name} was closed")
        if self._transport is not None:
            self._transport.close()
            await self._gone.wait()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self.close()


async def open_async_line(port: str, settings: LineSettings, **options: Any) -> AsyncLine:
    """As `open_line`, on the running loop."""
    chosen = LineOptions.parse({key: str(value) for key, value in options.items()}, {})
    return await opened(port, settings.with_options(**chosen.line_settings()), chosen)


async def opened(port: str, settings: LineSettings, options: LineOptions) -> AsyncLine:
    """Open a port for settings in which its options are already. Raises `PortError`."""
    refuse_kernel(port, options)
    network = "://" in port
    line = AsyncLine(settings, options, network=network, name=port)
    loop = asyncio.get_running_loop()
    if port.startswith("tcp://"):
        host, number = tcp_address(port)
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT):
                transport, _ = await loop.create_connection(lambda: line, host, number)
        except OSError as error:  # TimeoutError is one
            raise port_error(port, error) from error
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux; elsewhere the system's own, minutes
            own = transport.get_extra_info("socket")
            own.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, SWALLOWED)
        line.low_water = LowWater(transport.get_extra_info("socket"))
        return line
    await _open_serial(line, port, PortSetup(settings, options))
    return line


async def _open_serial(line: AsyncLine, port: str, setup: PortSetup) -> None:
    import serialx

    remote = port.startswith(RFC2217)
    if remote:
        tcp_address(port)
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT):
            transport, _ = await serialx.create_serial_connection(
                asyncio.get_running_loop(), lambda: line, port, **setup.serial_arguments(port)
            )
            if remote:  # serialx leaves them alone there
                await transport.set_modem_pins(setup.pins())
        line.marks = prepare(transport.serial, port, setup)
    except (Exception, asyncio.CancelledError) as error:
        await line.close()
        if isinstance(error, Error | asyncio.CancelledError):
            raise
        raise port_error(port, error) from error
