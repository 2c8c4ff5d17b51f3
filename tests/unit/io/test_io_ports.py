"""Ports: how they are opened, and the reasons why they are not, for a person."""

from __future__ import annotations

import errno
import fcntl
import os
import resource
import socket
import struct
import sys
from pathlib import Path

import pytest
import serialx

from multidrop.errors import PortError, UsageError
from multidrop.io import list_ports, ports, rs485
from multidrop.io.ports import SELECTABLE, PortSetup, TcpPort, port_error, tcp_address
from multidrop.naming import LineOptions
from multidrop.protocols import slink3
from multidrop.timing import Format


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(errno.ENOENT, "x"), "no such port ('multidrop ports' lists"),
        (OSError(errno.ENODEV, "x"), "no such port"),
        (OSError(errno.EBUSY, "x"), "busy: another program has it open"),
        (BlockingIOError(errno.EWOULDBLOCK, "x"), "busy"),
        (PermissionError(errno.EACCES, "x"), "no permission (on Linux: add yourself to the group"),
        (OSError(errno.ENOTTY, "x"), "not a serial port"),
        (OSError(errno.EISDIR, "x"), "not a serial port"),
        (ConnectionRefusedError(errno.ECONNREFUSED, "x"), "connection refused: nothing listens"),
        (TimeoutError("x"), "no connection within 5 s"),
        (socket.gaierror(-2, "x"), "no such host"),
        (OSError(errno.EIO, "Input/output error"), "Input/output error"),
        (serialx.SerialException("odd"), "odd"),
        (ValueError(), "ValueError"),
    ],
)
def test_why_a_port_cannot_be_opened(error: BaseException, reason: str) -> None:
    found = port_error("/dev/ttyUSB0", error)
    assert isinstance(found, PortError)
    assert str(found).startswith(f"cannot open /dev/ttyUSB0: {reason}")


def test_no_group_owns_a_port_of_the_network() -> None:
    found = port_error("tcp://10.0.0.255:4001", PermissionError(errno.EACCES, "Permission denied"))
    assert str(found) == "cannot open tcp://10.0.0.255:4001: Permission denied"


def test_why_a_port_was_lost_without_its_number() -> None:
    found = ports.lost("tcp://h:1", ConnectionResetError(errno.ECONNRESET, "Connection reset"))
    assert str(found) == "tcp://h:1 was lost: Connection reset"
    assert str(ports.lost("/dev/x", ValueError("odd"))) == "/dev/x was lost: odd"


def test_an_error_of_termios_is_no_os_error() -> None:
    import termios

    assert "not a serial port" in str(port_error("x", termios.error(errno.ENOTTY, "y")))


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("tcp://10.0.0.7:4001", ("10.0.0.7", 4001)),
        ("tcp://[::1]:4001/", ("::1", 4001)),
        ("rfc2217://host:1", ("host", 1)),
    ],
)
def test_addresses(url: str, address: tuple[str, int]) -> None:
    assert tcp_address(url) == address


@pytest.mark.parametrize(
    "url", ["tcp://", "tcp://h", "tcp://:1", "tcp://h:x", "tcp://h:65536", "tcp://h:1/p"]
)
def test_what_is_no_address(url: str) -> None:
    with pytest.raises(UsageError, match="tcp://"):
        tcp_address(url)


@pytest.mark.parametrize("selectable", [1024, 0], ids=["select", "poll"])
def test_a_socket_is_waited_for(selectable: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "SELECTABLE", selectable)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = TcpPort(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        peer, _ = server.accept()
        assert port.read(0.0) == b""
        peer.sendall(b"x")
        assert port.read(5.0) == b"x"
        peer.close()
        with pytest.raises(PortError, match="closed the connection"):
            port.read(5.0)
        port.close()


def test_a_file_descriptor_that_select_cannot_take() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 2048:
        pytest.skip("this machine allows no so many files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2048), hard))
    taken: list[int] = []
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            while not taken or taken[-1] < SELECTABLE:
                taken.append(os.dup(0))
            port = TcpPort(f"tcp://127.0.0.1:{server.getsockname()[1]}")
            peer, _ = server.accept()
            peer.sendall(b"x")
            assert port.read(5.0) == b"x"
            port.close()
            peer.close()
    finally:
        for fd in taken:
            os.close(fd)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def setup(**options: str) -> PortSetup:
    chosen = LineOptions.parse(options, {})
    return PortSetup(slink3.LINE.with_options(**chosen.line_settings()), chosen)


def test_what_a_serial_port_is_opened_with() -> None:
    found = setup(baud="19200", format="7O2", rts="off", dtr="on").serial_arguments("/dev/ttyUSB0")
    assert (found["baudrate"], found["byte_size"], found["parity"], found["stopbits"]) == (
        19200,
        7,
        "O",
        2,
    )
    assert (found["rts_on_open"], found["dtr_on_open"]) == (
        serialx.PinState.LOW,
        serialx.PinState.HIGH,
    )
    assert found["rts_on_close"] is found["dtr_on_close"] is serialx.PinState.LOW


@pytest.mark.parametrize("left", [{"rts": "leave"}, {"dtr": "leave"}])
def test_pins_that_are_left_alone_are_left_on_closing_too(left: dict[str, str]) -> None:
    found = setup(**left).serial_arguments("/dev/ttyUSB0")
    assert found["rts_on_close"] is found["dtr_on_close"] is serialx.PinState.UNDEFINED


def test_a_pseudo_terminal_has_8n1(tmp_path: Path) -> None:
    master, slave = os.openpty()
    link = tmp_path / "link"
    link.symlink_to(os.ttyname(slave))
    for url in (os.ttyname(slave), str(link)):
        found = setup().serial_arguments(url)
        assert Format(found["byte_size"], found["parity"], found["stopbits"]) == Format(8, "N", 1)
    os.close(master)
    os.close(slave)


def test_only_rfc2217_waits_for_answers_about_the_port() -> None:
    assert "read_timeout" in setup().serial_arguments("rfc2217://h:1")
    assert "read_timeout" not in setup().serial_arguments("/dev/ttyUSB0")


# -- RS-485 by the kernel --------------------------------------------------------------------------


def test_the_kernel_is_asked_to_switch(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(fcntl, "ioctl", lambda *arguments: asked.append(arguments))
    rs485.enable(7, "/dev/ttyS1")
    ((fd, request, settings),) = asked
    assert (fd, request) == (7, 0x542F)
    flags, before, after, *padding = struct.unpack("=8I", settings)
    assert flags == 0b11  # enabled, RTS on while sending, off after
    assert (before, after, padding) == (0, 0, [0] * 5)


def test_a_driver_that_cannot(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOTTY, "Inappropriate ioctl for device")

    monkeypatch.setattr(fcntl, "ioctl", refuse)
    with pytest.raises(PortError, match=r"/dev/ttyS1: its driver cannot switch .*direction=auto"):
        rs485.enable(7, "/dev/ttyS1")


def test_another_system(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(PortError, match="exists on Linux only"):
        rs485.enable(7, "/dev/cu.usbserial")


# -- the ports of this machine ---------------------------------------------------------------------


def test_the_ports_of_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = os.openpty()
    device = os.ttyname(slave)
    info = serialx.SerialPortInfo(
        device="/dev/serial/by-id/usb-x",
        resolved_device=device,
        vid=None,
        pid=None,
        serial_number=None,
        manufacturer="FTDI",
        product="RS-485 adapter",
        bcd_device=None,
        interface_description=None,
        interface_num=None,
    )
    monkeypatch.setattr(serialx, "list_serial_ports", lambda: [info])
    (found,) = list_ports.list_ports()
    os.close(master)
    os.close(slave)
    assert found.port == "/dev/serial/by-id/usb-x"
    assert found.adapter == "FTDI RS-485 adapter"
    assert f"({os.getpid()})" in found.busy
    assert (found.latency_ms, found.problem) == (None, "")
    assert set(found.fields()) == {"port", "device", "adapter", "busy", "latency_ms", "problem"}


def test_who_has_a_port_open(tmp_path: Path) -> None:
    for pid, name, target in (("12", "minicom", "/dev/ttyUSB0"), ("13", "cat", "/tmp/x")):
        (tmp_path / pid / "fd").mkdir(parents=True)
        (tmp_path / pid / "comm").write_text(name + "\n")
        (tmp_path / pid / "fd" / "3").symlink_to(target)
    (tmp_path / "14").mkdir()  # a program that has just ended
    assert list_ports._open_files(tmp_path) == {"/dev/ttyUSB0": "minicom (12)"}


def test_a_port_that_is_not_permitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *arguments: False)
    assert "no permission" in list_ports._problem("/dev/null")
    assert "no permission" in list_ports._problem("/dev/nowhere")
