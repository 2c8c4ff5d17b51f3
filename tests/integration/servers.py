"""TCP servers in a thread, well-behaved or not: what they received can be looked at."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator

from multidrop.events import FrameReceived
from multidrop.protocols.slink3 import Frame, decoder

PATIENCE = 20.0


class Server:
    """Accepts one connection after the other and lets `behave` do what it wants with it."""

    def __init__(self, behave: Callable[[Connected], None]) -> None:
        self.received = bytearray()
        self.connections = 0
        self._behave = behave
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._open: list[socket.socket] = []
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    @property
    def port(self) -> str:
        return f"tcp://127.0.0.1:{self._listening.getsockname()[1]}"

    def frames(self) -> list[Frame]:
        """The frames that came so far."""
        events = decoder().receive_data(bytes(self.received))
        return [event.frame for event in events if isinstance(event, FrameReceived)]

    def await_connections(self, count: int) -> None:
        """Wait until so many clients have been accepted."""
        until = time.monotonic() + PATIENCE
        while self.connections < count and time.monotonic() < until:
            time.sleep(0.005)
        assert self.connections >= count

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listening.accept()
            except OSError:
                return
            self.connections += 1
            self._open.append(connection)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with connection, contextlib.suppress(OSError):
                self._behave(Connected(connection, self.received))

    def close(self) -> None:
        for stop in (self._listening, *self._open):
            with contextlib.suppress(OSError):
                stop.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


class Connected:
    """One connection of a server, as its behaviour sees it."""

    def __init__(self, connection: socket.socket, received: bytearray) -> None:
        self.connection = connection
        self._received = received
        self._decoder = decoder()

    def requests(self) -> Iterator[Frame]:
        """The requests of the other side, until it goes."""
        while data := self.connection.recv(4096):
            self._received += data
            for event in self._decoder.receive_data(data):
                if isinstance(event, FrameReceived):
                    yield event.frame

    def pause(self, seconds: float) -> None:
        """The server's own time between two pieces of an answer."""
        time.sleep(seconds)

    def send(self, data: bytes) -> None:
        self.connection.sendall(data)


@contextlib.contextmanager
def serving(behave: Callable[[Connected], None]) -> Iterator[Server]:
    server = Server(behave)
    try:
        yield server
    finally:
        server.close()


@contextlib.contextmanager
def answering(answer: Callable[[Frame], Frame | None]) -> Iterator[Server]:
    """A slave that answers each request as a function says; None is silence."""

    def behave(line: Connected) -> None:
        for request in line.requests():
            reply = answer(request)
            if reply is not None:
                line.send(reply.encode())

    with serving(behave) as server:
        yield server


def reply_to(request: Frame, code: int = 0, data: bytes = b"") -> Frame:
    """The answer of the slave that was asked."""
    return Frame(request.address, request.control, request.order | 1, code, data)
