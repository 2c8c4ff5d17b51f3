"""Where other programs reach this one: a TCP port or a pseudo-terminal."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import Callable
from ipaddress import ip_address
from pathlib import Path
from typing import Protocol

from multidrop.errors import PortError, UsageError
from multidrop.io.ports import port_error, tcp_address

BUFFER = 4096
"""Bytes that are read at once: one program's flood does not keep the others waiting."""

MOST_UNREAD = 1 << 20
"""Bytes that wait for a program that does not read; what comes then is lost, as on a wire."""


class Caller(Protocol):
    """A program that is connected, as this side sees it."""

    name: str

    def write(self, data: bytes) -> None: ...
    def hang_up(self) -> None:
        """End the connection; a pseudo-terminal stays, and its program begins anew."""
        ...

    def pause(self) -> None:
        """Read no more from it for now."""
        ...

    def resume(self) -> None: ...


class Called(Protocol):
    """What a program is connected to."""

    def receive(self, data: bytes) -> None: ...
    def close(self) -> None:
        """The program has gone."""
        ...


Answer = Callable[[Caller], Called]
"""Takes a call."""


class Listener(Protocol):
    """What is listening. `port` is where, as a device's name has it."""

    port: str
    loopback: bool
    """Whether only programs of this machine reach it."""

    def close(self) -> None: ...


class _TcpCaller(asyncio.BufferedProtocol):
    """A program that is connected over TCP."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self._buffer = bytearray(BUFFER)
        self.name = ""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        host, number = (transport.get_extra_info("peername") or ("?", 0))[:2]
        self.name = _shown(host, number)
        self._called = self._answer(self)

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self._called.receive(bytes(self._buffer[:nbytes]))

    def connection_lost(self, error: Exception | None) -> None:
        self._called.close()

    def write(self, data: bytes) -> None:
        if self._transport.get_write_buffer_size() <= MOST_UNREAD:
            self._transport.write(data)

    def hang_up(self) -> None:
        self._transport.close()

    def pause(self) -> None:
        self._transport.pause_reading()

    def resume(self) -> None:
        self._transport.resume_reading()


class TcpListener:
    def __init__(self, server: asyncio.Server) -> None:
        self._server = server
        host, number = server.sockets[0].getsockname()[:2]
        self.port = f"tcp://{_shown(host, number)}"
        self.loopback = all(
            ip_address(listening.getsockname()[0].partition("%")[0]).is_loopback
            for listening in server.sockets
        )

    def close(self) -> None:
        self._server.close()


def _shown(host: str, number: int) -> str:
    return f"[{host}]:{number}" if ":" in host else f"{host}:{number}"


class PtyListener:
    """A pseudo-terminal whose other side programs open as a serial port, under `link` if given."""

    loopback = True

    def __init__(self, answer: Answer, link: str) -> None:
        import tty

        self._fd, self._other_side = os.openpty()  # kept open, so that programs may come and go
        tty.setraw(self._fd)
        os.set_blocking(self._fd, False)
        self.port = os.ttyname(self._other_side)
        self._link = Path(link) if link else None
        if self._link is not None:
            self._make_link(self._link)
        self.name = self.port
        self._loop = asyncio.get_running_loop()
        self._answer = answer
        self._called = answer(self)
        self._loop.add_reader(self._fd, self._read)

    def _make_link(self, link: Path) -> None:
        try:
            if link.is_symlink() and (not link.exists() or os.readlink(link) == self.port):
                link.unlink()  # left over from a program that was killed
            link.symlink_to(self.port)
        except OSError as error:
            os.close(self._fd)
            os.close(self._other_side)
            raise PortError(f"cannot make {link}: {error.strerror}") from None
        self.port = str(link)

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError, OSError):
            self._called.receive(os.read(self._fd, BUFFER))

    def write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # nobody reads: the bytes are lost, as on a wire
            os.write(self._fd, data)

    def hang_up(self) -> None:
        self._called.close()
        self._called = self._answer(self)

    def pause(self) -> None:
        self._loop.remove_reader(self._fd)

    def resume(self) -> None:
        self._loop.add_reader(self._fd, self._read)

    def close(self) -> None:
        self._loop.remove_reader(self._fd)
        self._called.close()
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._fd)
        os.close(self._other_side)


async def listen(where: str, answer: Answer) -> TcpListener | PtyListener:
    """Listen at `tcp://HOST:PORT` (port 0: any free one) or `pty[:LINK]`; `answer` takes each call.

    Raises `UsageError` for another address, `PortError` where it cannot listen.
    """
    if where == "pty" or where.startswith("pty:"):
        return PtyListener(answer, where[4:])
    if not where.startswith("tcp://"):
        raise UsageError(
            f"{where!r} is no address to listen on: tcp://127.0.0.1:4001 or pty[:LINK]"
        )
    host, number = tcp_address(where)
    loop = asyncio.get_running_loop()
    try:
        server = await loop.create_server(lambda: _TcpCaller(answer), host, number)
    except PermissionError as error:
        raise PortError(
            f"cannot listen on {where}: no permission (ports below 1024 are the system's)"
        ) from error
    except OSError as error:
        cause = port_error(where, error)
        raise PortError(str(cause).replace("cannot open", "cannot listen on")) from error
    for open_socket in server.sockets:
        with contextlib.suppress(OSError):
            open_socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return TcpListener(server)
