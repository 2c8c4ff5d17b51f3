"""A serial device server that speaks RFC 2217: pyserial's, on a port of this machine."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from typing import Any

import serial
from serial import rfc2217


class PinlessSerial(serial.Serial):
    """A pseudo-terminal as a serial port: it has no pins and no parity, so they are written down."""

    def __init__(self, port: str) -> None:
        self.pins: dict[str, bool] = {}
        self._configured = False
        super().__init__(port, timeout=0.05)

    def _reconfigure_port(self, force_update: bool = False) -> None:
        if not self._configured:  # raw mode; what else is set later changes nothing on its wire
            super()._reconfigure_port(force_update)  # type: ignore[misc]
        self._configured = True

    def _update_rts_state(self) -> None:
        self.pins["rts"] = self._rts_state  # type: ignore[attr-defined]

    def _update_dtr_state(self) -> None:
        self.pins["dtr"] = self._dtr_state  # type: ignore[attr-defined]

    cts = dsr = ri = cd = property(lambda self: False)


class Acknowledging(rfc2217.PortManager):
    """Acknowledges the masks too, as RFC 2217 has it: pyserial forgets, and clients wait for it."""

    def _telnet_process_subnegotiation(self, suboption: bytes) -> None:
        super()._telnet_process_subnegotiation(suboption)  # type: ignore[misc]
        answers = {
            rfc2217.SET_LINESTATE_MASK: rfc2217.SERVER_SET_LINESTATE_MASK,
            rfc2217.SET_MODEMSTATE_MASK: rfc2217.SERVER_SET_MODEMSTATE_MASK,
        }
        answer = answers.get(suboption[1:2])
        if answer is not None:
            self.rfc2217_send_subnegotiation(answer, suboption[2:3])


class SerialServer:
    """Serves one client after the other; `port` is where, `serial` what it serves."""

    def __init__(self, port: str) -> None:
        self.serial = PinlessSerial(port)
        self.serial.pins.clear()
        self.settings: tuple[Any, ...] = ()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._client: socket.socket | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    @property
    def port(self) -> str:
        return f"rfc2217://127.0.0.1:{self._listening.getsockname()[1]}"

    def _serve(self) -> None:
        while not self._closing:
            with contextlib.suppress(OSError):
                self._client, _ = self._listening.accept()
                with self._client:
                    self._bridge(self._client)

    def _bridge(self, client: socket.socket) -> None:
        gone = threading.Event()
        port: Any = self.serial
        writing: Any = _Writing(client)
        manager = Acknowledging(port, writing)
        reader = threading.Thread(target=self._to_client, args=(manager, client, gone), daemon=True)
        reader.start()
        try:
            while data := client.recv(1024):
                self.serial.write(b"".join(manager.filter(data)))
                found = self.serial
                self.settings = (found.baudrate, found.bytesize, found.parity, found.stopbits)
        finally:
            gone.set()
            reader.join()

    def _to_client(self, manager: Any, client: socket.socket, gone: threading.Event) -> None:
        with contextlib.suppress(OSError):
            while not gone.is_set():
                data = self.serial.read(self.serial.in_waiting or 1)
                if data:
                    client.sendall(b"".join(manager.escape(data)))

    def hang_up(self) -> None:
        """The client's connection ends."""
        assert self._client is not None
        self._client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._closing = True
        for stop in (self._listening, self._client):
            if stop is not None:
                with contextlib.suppress(OSError):
                    stop.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self._thread.join(20)
        self.serial.close()


class _Writing:
    """What pyserial writes its telnet options to."""

    def __init__(self, client: socket.socket) -> None:
        self._client = client

    def write(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self._client.sendall(data)


@contextlib.contextmanager
def serial_server(port: str) -> Iterator[SerialServer]:
    server = SerialServer(port)
    try:
        yield server
    finally:
        server.close()
