"""A blocking line: runs conversations on a port."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, Generic, NamedTuple, Self, TypeVar

from multidrop.conversation import Conversation
from multidrop.errors import Error, NoReply
from multidrop.exchange import Exchange
from multidrop.io.ports import Port, PortSetup, open_port
from multidrop.naming import LineOptions
from multidrop.session import Counters, Delays, Session
from multidrop.timing import LineSettings

ResultT = TypeVar("ResultT")
StepT = TypeVar("StepT")

MOST_DRAINED = 256
"""Reads, of 4096 bytes at most: a line that never falls silent is found out by the exchange."""

Tap = Callable[[bytes, bool, float, bool], None]
"""Called with every piece of bytes, whether this side sent it, its monotonic time, and whether
the port marked it as damaged (parity, framing)."""


class Timed(NamedTuple, Generic[ResultT]):
    """What a conversation returned, and its last answer's receipt (monotonic, s) and duration (s)."""

    result: ResultT
    received_at: float
    seconds: float


def new_session(settings: LineSettings, options: LineOptions, *, network: bool) -> Session[Any]:
    """The memory of a line that was just opened."""
    timing = settings.timing(network=network)
    return Session(settings.decoder(), timing, echo=options.hears_itself)


class Line:
    """One wire with one master: this one. Not for several threads at once."""

    def __init__(
        self, port: Port, settings: LineSettings, options: LineOptions | None = None
    ) -> None:
        self.port = port
        self.settings = settings
        self.taps: list[Tap] = []
        self.acted = False  # whether the last exchange sent more than reads
        self._session = new_session(settings, options or LineOptions(), network=port.network)
        self._running: Exchange[Any, Any] | None = None  # waits for its answer

    @property
    def counters(self) -> Counters:
        return self._session.counters

    @property
    def delays(self) -> Delays:
        """How long after its echo each Datalink Acknowledge was written."""
        return self._session.delays

    def run(self, conversation: Conversation[Any, ResultT]) -> ResultT:
        """Carry out a conversation; returns what it returns, raises what it raises, or `PortError`."""
        return self.timed(conversation).result

    def timed(self, conversation: Conversation[Any, ResultT]) -> Timed[ResultT]:
        """The same with the time of the last answer."""
        return self._finish(self._begin(conversation))

    def each(
        self, conversations: Iterable[Conversation[Any, ResultT]]
    ) -> Iterator[Timed[ResultT] | Error]:
        """Carry out conversations one behind the other; gives what each returned, or its error.

        Behind an answer the next one begins before the result is given: what is done
        with that costs the line no time. Behind an error the next one waits until that
        was given. Something else on this line in between gives up what is on its way.
        """
        found: Timed[ResultT] | Error | None = None
        for conversation in conversations:
            if isinstance(found, Error):
                yield found
                found = None
            exchange = _tried(self._begin, conversation)
            if found is not None:
                yield found
            found = exchange if isinstance(exchange, Error) else _tried(self._finish, exchange)
        if found is not None:
            yield found

    def _begin(self, conversation: Conversation[Any, ResultT]) -> Exchange[Any, ResultT]:
        """Send its first request, if the line has rested; `_finish` has to follow."""
        self._give_up()
        exchange = Exchange(conversation, self._session)
        self._drain()
        self._running = exchange
        try:
            self._write(exchange, exchange.start(self.port.now()))
        except BaseException:
            self._give_up()
            raise
        return exchange

    def _finish(self, exchange: Exchange[Any, ResultT]) -> Timed[ResultT]:
        port = self.port
        if exchange is not self._running:
            raise NoReply(1, because="the line was used for something else")
        try:
            while not exchange.done:
                data = port.read(exchange.deadline - port.now())
                self._write(exchange, self._advance(exchange, data, port.now()))
        except BaseException:
            self._give_up()
            raise
        self._running = None
        self.acted = exchange.acted
        result = exchange.result()
        received_at = exchange.received_at if exchange.received_at is not None else port.now()
        return Timed(result, received_at, received_at - exchange.asked_at)

    def _give_up(self) -> None:
        """What waits for an answer waits no longer; one that comes late will not be believed."""
        if self._running is not None:
            self.acted = self._running.acted
            self._running.abandon(self.port.now())
            self._running = None

    def _write(self, exchange: Exchange[Any, Any], to_send: bytes) -> None:
        if to_send:
            self.port.write(to_send)
            if exchange.told is not None:
                exchange.written(self.port.now())
            for tap in self.taps:
                tap(to_send, True, exchange.asked_at, False)

    def _advance(self, exchange: Exchange[Any, Any], data: bytes, now: float) -> bytes:
        if not data:
            return exchange.advance(b"", now)
        return b"".join(
            exchange.advance(piece, now, damaged=damaged)
            for piece, damaged in self._pieces(data, now)
        )

    def _pieces(self, data: bytes, now: float) -> list[tuple[bytes, bool]]:
        """What came, without the port's marks, shown to the taps."""
        marks = self.port.marks
        pieces = [(data, False)] if marks is None else marks.split(data)
        for tap in self.taps:
            for piece, damaged in pieces:
                tap(piece, False, now, damaged)
        return pieces

    def _drain(self) -> None:
        """What came while nobody asked is counted and never believed."""
        for _ in range(MOST_DRAINED):
            data = self.port.read(0.0)
            if not data:
                return
            now = self.port.now()
            for piece, damaged in self._pieces(data, now):
                self._session.drain(piece, now, damaged=damaged)

    def close(self) -> None:
        self.port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _tried(step: Callable[[StepT], ResultT], of: StepT) -> ResultT | Error:
    try:
        return step(of)
    except Error as error:
        return error


def open_line(port: str, settings: LineSettings, **options: Any) -> Line:
    """Open a port for a protocol's `LINE`; options are the keys of a device's name.

    Raises `UsageError` for an option out of range, `PortError` where the port
    cannot be opened.
    """
    chosen = LineOptions.parse({key: str(value) for key, value in options.items()}, {})
    settings = settings.with_options(**chosen.line_settings())
    return Line(open_port(port, PortSetup(settings, chosen)), settings, chosen)
