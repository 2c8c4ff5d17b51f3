"""Puts a simulated line where programs can reach it: a TCP port or a pseudo-terminal."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from multidrop.errors import PortError, UsageError
from multidrop.io.ports import port_error, tcp_address
from multidrop.sim.line import Connection, SimulatedLine

SPIN = 0.001
"""s before something is due from which a spinning line no longer sleeps."""


class Listener(Protocol):
    """A line that is being served. `port` is where, as a device's name has it."""

    port: str

    def close(self) -> None: ...


class _End:
    """One end of a simulated line, driven by the loop's clock."""

    def __init__(self, line: SimulatedLine, write: Callable[[bytes], object], spin: bool) -> None:
        self._end: Connection = line.attach()
        self._write = write
        self._spin = spin
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None

    def receive(self, data: bytes) -> None:
        self._end.receive(data, self._loop.time())
        self._pump()

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _pump(self) -> None:
        """Send what is due, and come back when more is."""
        end = self._end
        while True:
            data = end.send(self._loop.time())
            if data:
                self._write(data)
            deadline = end.deadline
            if deadline == float("inf"):
                return
            left = deadline - time.monotonic()
            if left > 0 and not (self._spin and left <= SPIN):
                break
            while time.monotonic() < deadline:
                pass
        if self._timer is not None:
            self._timer.cancel()
        early = SPIN if self._spin else 0.0
        self._timer = self._loop.call_at(deadline - early, self._pump)


class _Client(asyncio.Protocol):
    """A program that is connected over TCP."""

    def __init__(self, line: SimulatedLine, spin: bool) -> None:
        self._line = line
        self._spin = spin

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.WriteTransport)
        self._end = _End(self._line, transport.write, self._spin)

    def data_received(self, data: bytes) -> None:
        self._end.receive(data)

    def connection_lost(self, error: Exception | None) -> None:
        self._end.close()


class TcpListener:
    def __init__(self, server: asyncio.Server) -> None:
        self._server = server
        host, number = server.sockets[0].getsockname()[:2]
        self.port = f"tcp://[{host}]:{number}" if ":" in host else f"tcp://{host}:{number}"

    def close(self) -> None:
        self._server.close()


class PtyListener:
    """A pseudo-terminal whose other side programs open as a serial port, under `link` if given."""

    def __init__(self, line: SimulatedLine, link: str, spin: bool) -> None:
        import tty

        self._fd, self._other_side = os.openpty()  # kept open, so that programs may come and go
        tty.setraw(self._fd)
        os.set_blocking(self._fd, False)
        self.port = os.ttyname(self._other_side)
        self._link = Path(link) if link else None
        if self._link is not None:
            self._make_link(self._link)
        self._loop = asyncio.get_running_loop()
        self._end = _End(line, self._write, spin)
        self._loop.add_reader(self._fd, self._read)

    def _make_link(self, link: Path) -> None:
        if link.is_symlink() and (not link.exists() or os.readlink(link) == self.port):
            link.unlink()  # left over from a simulation that was killed
        try:
            link.symlink_to(self.port)
        except OSError as error:
            os.close(self._fd)
            os.close(self._other_side)
            raise PortError(f"cannot make {link}: {error.strerror}") from None
        self.port = str(link)

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError, OSError):
            self._end.receive(os.read(self._fd, 4096))

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # nobody reads: the bytes are lost, as on a wire
            os.write(self._fd, data)

    def close(self) -> None:
        self._loop.remove_reader(self._fd)
        self._end.close()
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._fd)
        os.close(self._other_side)


async def serve(line: SimulatedLine, listen: str, *, spin: bool = False) -> Listener:
    """Serve a line at `tcp://HOST:PORT` (port 0: any free one) or `pty[:LINK]`.

    Raises `UsageError` for another address, `PortError` where it cannot listen.
    """
    if listen == "pty" or listen.startswith("pty:"):
        return PtyListener(line, listen[4:], spin)
    if not listen.startswith("tcp://"):
        raise UsageError(
            f"{listen!r} is no address to listen on: tcp://127.0.0.1:4001 or pty[:LINK]"
        )
    host, number = tcp_address(listen)
    loop = asyncio.get_running_loop()
    try:
        server = await loop.create_server(lambda: _Client(line, spin), host, number)
    except OSError as error:
        cause = port_error(listen, error)
        raise PortError(str(cause).replace("cannot open", "cannot listen on")) from error
    for open_socket in server.sockets:
        with contextlib.suppress(OSError):
            open_socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return TcpListener(server)
