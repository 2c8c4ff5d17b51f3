"""Ports for a blocking line: serial ports and RFC 2217 by serialx, raw TCP by the socket module.

A port says what time it is, since a simulated wire has a time of its own.
"""

from __future__ import annotations

import errno
import os
import re
import select
import socket
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol
from urllib.parse import urlsplit

from multidrop.errors import PortError, UsageError
from multidrop.io.parity import ParityMarks
from multidrop.naming import LineOptions
from multidrop.timing import Format, LineSettings

if TYPE_CHECKING:
    from serialx import BaseSerial, ModemPins

CONNECT_TIMEOUT = 5.0
SELECTABLE = 1024
"""select takes file descriptors below this one; a program with many lines has others too."""

PSEUDO_TERMINALS = "/dev/pts/"
RFC2217 = "rfc2217://"


class Port(Protocol):
    """A wire's end. `network` chooses the slack of the times; `marks` is set where bytes carry marks."""

    network: bool
    marks: ParityMarks | None

    def now(self) -> float:
        """Monotonic time, s."""
        ...

    def read(self, timeout: float) -> bytes:
        """What has arrived, waiting at most `timeout` s for it; b"" for nothing. Raises `PortError`."""
        ...

    def write(self, data: bytes) -> None: ...
    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class PortSetup:
    """How to open a port: the line's settings and what the user set of the port itself."""

    settings: LineSettings
    options: LineOptions

    def pins(self) -> ModemPins:
        """What RTS and DTR are set to on opening."""
        from serialx import ModemPins, PinState

        states = {"on": PinState.HIGH, "off": PinState.LOW, "leave": PinState.UNDEFINED}
        return ModemPins(rts=states[self.options.rts], dtr=states[self.options.dtr])

    def serial_arguments(self, url: str) -> dict[str, Any]:
        """The keyword arguments of serialx for these settings of the port `url`."""
        from serialx import PinState

        pins = self.pins()
        character = self.settings.format
        if os.path.realpath(url).startswith(PSEUDO_TERMINALS):
            character = Format(8, "N", 1)  # it has no other, and Linux may refuse to be asked
        leave = "leave" in (self.options.rts, self.options.dtr)
        on_close = PinState.UNDEFINED if leave else PinState.LOW
        arguments: dict[str, Any] = {}
        if url.startswith(RFC2217):  # else it would wait for ever for an answer about the pins
            limits = ("connect_timeout", "read_timeout", "write_timeout")
            arguments = dict.fromkeys(limits, CONNECT_TIMEOUT)
        return {
            **arguments,
            "baudrate": self.settings.baud,
            "byte_size": character.data_bits,
            "parity": character.parity,
            "stopbits": character.stop_bits,
            "rts_on_open": pins.rts,
            "dtr_on_open": pins.dtr,
            "rts_on_close": on_close,
            "dtr_on_close": on_close,
        }


def open_port(url: str, setup: PortSetup) -> Port:
    """Open a port by its device name or URL. Raises `PortError` that says which and why."""
    refuse_kernel(url, setup.options)
    if url.startswith("tcp://"):
        return TcpPort(url)
    return SerialPort(url, setup)


def refuse_kernel(url: str, options: LineOptions) -> None:
    """The kernel here does not switch a transmitter there. Raises `PortError`."""
    if options.direction == "kernel" and "://" in url:
        raise PortError(f"{url}: direction=kernel needs a serial port of this machine")


def tcp_address(url: str) -> tuple[str, int]:
    """Host and port number of a `tcp://` or `rfc2217://` URL. Raises `UsageError`."""
    try:
        parts = urlsplit(url)
        host, number = parts.hostname, parts.port
    except ValueError as error:
        raise UsageError(f"{url!r}: {error}") from None
    if not host or number is None or parts.path not in ("", "/"):
        raise UsageError(f"{url!r} is not of the form {parts.scheme or 'tcp'}://HOST:PORT")
    return host, number


_NO_SUCH_PORT = "no such port ('multidrop ports' lists the ports of this machine)"
_BUSY = "busy: another program has it open"
_NO_PERMISSION = "no permission (on Linux: add yourself to the group that owns it, often dialout)"
_NO_SERIAL_PORT = "not a serial port"
_REASONS = {
    errno.EADDRINUSE: "another program listens there already (port 0 takes any free one)",
    errno.ENOENT: _NO_SUCH_PORT,
    errno.ENODEV: _NO_SUCH_PORT,
    errno.ENXIO: _NO_SUCH_PORT,
    errno.EBUSY: _BUSY,
    errno.EWOULDBLOCK: _BUSY,
    errno.EACCES: _NO_PERMISSION,
    errno.EPERM: _NO_PERMISSION,
    errno.ENOTTY: _NO_SERIAL_PORT,
    errno.EISDIR: _NO_SERIAL_PORT,
}


def port_error(url: str, error: BaseException) -> PortError:
    """The reason why a port cannot be opened, for a person."""
    if type(error).__name__ == "error" and len(error.args) == 2:  # termios.error is no OSError
        error = OSError(*error.args)
    number = getattr(error, "errno", None)
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    if isinstance(error, socket.gaierror):
        reason = "no such host"
    elif isinstance(error, TimeoutError) and url.startswith(RFC2217):
        reason = (
            f"no RFC 2217 answer within {CONNECT_TIMEOUT:g} s (a raw socket is tcp://HOST:PORT)"
        )
    elif isinstance(error, TimeoutError):
        reason = f"no connection within {CONNECT_TIMEOUT:g} s"
    elif isinstance(error, ConnectionRefusedError):
        reason = "connection refused: nothing listens there"
    elif number == errno.ENOENT and re.fullmatch(r"[\w.-]+:[0-9]+", url):
        reason = f"no such port; a device server is tcp://{url}"
    elif number in (errno.EACCES, errno.EPERM) and "://" in url:  # no group owns it
        reason = text
    else:
        reason = _REASONS.get(number, text) if number is not None else text
    return PortError(f"cannot open {url}: {reason}")


def lost(url: str, why: str | BaseException) -> PortError:
    """`why` without the number that the system has for it."""
    return PortError(f"{url} was lost: {getattr(why, 'strerror', None) or why}")


class TcpPort:
    """A raw socket to a serial device server."""

    network = True
    marks: ParityMarks | None = None
    now = staticmethod(time.monotonic)

    def __init__(self, url: str) -> None:
        self._url = url
        try:
            self._socket = socket.create_connection(tcp_address(url), CONNECT_TIMEOUT)
        except OSError as error:
            raise port_error(url, error) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)
        self._poll: select.poll | None = None
        if self._socket.fileno() >= SELECTABLE and hasattr(select, "poll"):
            self._poll = select.poll()
            self._poll.register(self._socket, select.POLLIN)

    def _ready(self, timeout: float) -> bool:
        """Whether anything came within `timeout` s, at least 0."""
        if self._poll is not None:
            return bool(self._poll.poll(timeout * 1000))
        # where it can be had: poll, and the socket's own timeout, are rounded up to a millisecond
        return bool(select.select([self._socket], [], [], timeout)[0])

    def read(self, timeout: float) -> bytes:
        try:
            if not self._ready(max(timeout, 0.0)):
                return b""
            data = self._socket.recv(4096)
        except (OSError, ValueError) as error:
            raise lost(self._url, error) from error
        if not data:
            raise lost(self._url, "the other side closed the connection")
        return data

    def write(self, data: bytes) -> None:
        try:
            self._socket.settimeout(CONNECT_TIMEOUT)
            self._socket.sendall(data)
            self._socket.setblocking(False)
        except OSError as error:
            raise lost(self._url, error) from error

    def close(self) -> None:
        self._socket.close()


class SerialPort:
    """A serial port of this machine, or of an RFC 2217 server."""

    now = staticmethod(time.monotonic)

    def __init__(self, url: str, setup: PortSetup) -> None:
        import serialx

        self._url = url
        self.network = "://" in url
        if url.startswith(RFC2217):
            tcp_address(url)
        self._buffer = bytearray(4096)
        try:
            self._serial = serialx.serial_for_url(url, **setup.serial_arguments(url))
            self._serial.open()
        except Exception as error:  # serialx raises what the platform raised
            raise port_error(url, error) from error
        try:
            if url.startswith(RFC2217):  # serialx leaves them alone there
                self._serial.set_modem_pins(setup.pins())
            self.marks = prepare(self._serial, url, setup)
        except PortError:
            self.close()
            raise
        except Exception as error:
            self.close()
            raise port_error(url, error) from error

    def read(self, timeout: float) -> bytes:
        try:
            count = self._serial.readinto(self._buffer, timeout=max(timeout, 0.0))
        except Exception as error:  # serialx raises what the platform raised
            raise lost(self._url, error) from error
        return bytes(self._buffer[:count])

    def write(self, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[self._serial.write(view, timeout=CONNECT_TIMEOUT) :]
        except Exception as error:
            raise lost(self._url, error) from error

    def close(self) -> None:
        self._serial.close()


def prepare(serial: BaseSerial, url: str, setup: PortSetup) -> ParityMarks | None:
    """Ask an open port to mark wrong bytes, and the kernel to switch direction where that was set."""
    try:
        fd = serial.fileno()
    except (OSError, AssertionError, AttributeError):
        fd = -1
    if setup.options.direction == "kernel":
        from multidrop.io import rs485

        rs485.enable(fd, url)
    if fd < 0 or "://" in url or setup.settings.format.parity == "N":
        return None
    try:
        import termios
    except ImportError:  # Windows reports errors apart from the bytes
        return None
    attributes = termios.tcgetattr(fd)
    attributes[0] |= termios.INPCK | termios.PARMRK
    termios.tcsetattr(fd, termios.TCSANOW, attributes)
    return ParityMarks()
