"""The extcap: what Wireshark asks of it, and what it hears on a line that others speak on."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from integration.processes import PATIENCE, Running, multidrop
from integration.tshark import info_field, tshark, tshark_path
from multidrop.errors import UsageError
from multidrop.io.captured import CaptureReader, Packet
from multidrop.io.list_ports import PortFacts
from multidrop.naming import LineOptions
from multidrop.protocols import PROTOCOLS, datalink, slink3
from multidrop.timing import Format
from multidrop.tools.captures import extcap, wireshark

ADAPTER = PortFacts("/dev/serial/by-id/usb-1", "/dev/ttyUSB0", "FTDI {A}", "", 16, "")

READ = slink3.Frame(2, 4, 0, 0x26, bytes.fromhex("00 2C 20"))
ANSWER = slink3.Frame(2, 4, 1, 0, bytes.fromhex("03 2C 20 07 00"))
PIECES = (READ.encode()[:5], READ.encode()[5:], ANSWER.encode() + b"\x01\x02")
HEARD = [READ.encode(), ANSWER.encode(), b"\x01\x02"]


# -- what Wireshark asks -----------------------------------------------------------------------------


def test_each_port_is_an_interface_and_one_is_for_any_other() -> None:
    program, usb, any_port = extcap.interfaces([ADAPTER])
    assert program.startswith("extcap {version=")
    assert usb == "interface {value=multidrop-ttyUSB0}{display=multidrop: /dev/ttyUSB0, FTDI (A)}"
    assert any_port == "interface {value=multidrop}{display=multidrop: a port of your choice}"


def test_link_types_are_those_of_captures() -> None:
    assert extcap.link_types() == [
        "dlt {number=147}{name=USER0}{display=slink3}",
        "dlt {number=148}{name=USER1}{display=datalink}",
        "dlt {number=149}{name=USER2}{display=ultra3000}",
        "dlt {number=150}{name=USER3}{display=bytes of no known protocol}",
    ]


@pytest.mark.parametrize(
    ("interface", "first"), [("multidrop", "port"), ("multidrop-x", "protocol")]
)
def test_every_setting_is_an_option_of_the_command(interface: str, first: str) -> None:
    lines = extcap.settings(interface)
    calls = [line.partition("{call=--")[2].partition("}")[0] for line in lines if "{call" in line]
    wanted = ["port", "protocol", "baud", "format", "stuffing"]
    assert calls == wanted[wanted.index(first) :]
    assert "{arg=0}{value=auto}" in extcap.settings("multidrop-x")[1]
    defaults = [line for line in lines if "{default=true}" in line]
    assert len(defaults) == 4


def test_ports_of_interfaces() -> None:
    assert extcap.port_of("multidrop-ttyUSB0", [ADAPTER], "") == "/dev/ttyUSB0"
    assert extcap.port_of("multidrop", [], "tcp://127.0.0.1:1") == "tcp://127.0.0.1:1"
    for interface, given in [
        ("multidrop-x", ""),
        ("multidrop", ""),
        ("multidrop", "rfc2217://a:1"),
    ]:
        with pytest.raises(UsageError):
            extcap.port_of(interface, [ADAPTER], given)


def test_options_become_the_settings_of_the_line() -> None:
    given = {"baud": "19200", "format": "8N1", "stuffing": "off"}
    found = extcap.Listening.parse("/dev/x", "datalink", given)
    assert found.protocol is not None
    assert found.protocol.name == "datalink"
    assert (found.setup.settings.baud, found.setup.settings.format) == (19200, Format(8, "N", 1))
    assert found.line(found.protocol).own == {"stuffing": "off"}
    change = datalink.Frame(datalink.Command.CHANGE, 1, 0x600, 1, b"\x7e")
    decoder = found.setup.settings.decoder()
    assert [event.raw for event in decoder.receive_data(change.encode(stuffing=False))] == [
        change.encode(stuffing=False)
    ]


@pytest.mark.parametrize("protocol", ["", "auto", "slink3"])
def test_a_line_is_listened_to_with_its_pins_as_they_are(protocol: str) -> None:
    found = extcap.Listening.parse("/dev/x", protocol, {"baud": "default", "stuffing": "off"})
    options = found.setup.options
    assert options == LineOptions(rts="leave", dtr="leave", own={"stuffing": "off"})
    assert found.line(PROTOCOLS["slink3"]).own == {}
    assert found.setup.settings.baud == 9600


def test_a_protocol_that_there_is_not() -> None:
    with pytest.raises(UsageError, match="modbus"):
        extcap.Listening.parse("/dev/x", "modbus", {})


def test_the_command_answers_wireshark() -> None:
    named = multidrop("extcap", "--extcap-interfaces", "--extcap-version=4.0")
    assert "interface {value=multidrop}" in named.out
    assert "USER2" in multidrop("extcap", "--extcap-interface", "multidrop", "--extcap-dlts").out
    asked = multidrop("extcap", "--extcap-interface", "multidrop", "--extcap-config")
    assert "{call=--port}" in asked.out
    assert multidrop("extcap").status == 2
    assert multidrop("extcap", "--extcap-interface", "multidrop", "--capture").status == 2


# -- what it hears -------------------------------------------------------------------------------------


Tap = tuple[str, Callable[[bytes], None], Callable[[], bytes]]
"""Its port, what says something on the line, and what came from the listener."""


@contextlib.contextmanager
def tcp_tap() -> Iterator[Tap]:
    server = socket.create_server(("127.0.0.1", 0))
    accepted: list[socket.socket] = []
    thread = threading.Thread(target=lambda: accepted.append(server.accept()[0]), daemon=True)
    thread.start()

    def say(data: bytes) -> None:
        thread.join(PATIENCE)
        accepted[0].sendall(data)

    def came() -> bytes:
        accepted[0].setblocking(False)
        try:
            return accepted[0].recv(100)
        except BlockingIOError:
            return b""

    with server:
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}", say, came
        for connection in accepted:
            connection.close()


@contextlib.contextmanager
def pty_tap() -> Iterator[Tap]:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)

    def came() -> bytes:
        try:
            return os.read(ours, 100)
        except BlockingIOError:
            return b""

    try:
        yield os.ttyname(theirs), lambda data: (os.write(ours, data), None)[1], came
    finally:
        os.close(ours)
        os.close(theirs)


def listen_to(port: str, fifo: Path, protocol: str) -> Running:
    asked = ["--extcap-interface", "multidrop", "--port", port, "--protocol", protocol]
    return Running(
        sys.executable, "-m", "multidrop", "extcap", "--capture", "--fifo", str(fifo), *asked
    )


class Fifo:
    """Reads a capture from a FIFO, as Wireshark does."""

    def __init__(self, path: Path) -> None:
        self._pipe = os.open(path, os.O_RDONLY)
        self._copy = path.with_suffix(".pcapng")
        self._data = b""

    def packets(self, count: int) -> list[Packet]:
        """What has come, once that many packets are in it."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            self._copy.write_bytes(self._data)
            reader = CaptureReader(self._copy) if len(self._data) > 32 else None
            found = list(reader.packets()) if reader is not None else []
            if reader is not None and reader.interfaces and len(found) >= count:
                return found
            self._data += os.read(self._pipe, 65536)
        raise AssertionError(f"{len(self._data)} bytes and no {count} packets")

    def close(self) -> None:
        os.close(self._pipe)


@pytest.mark.parametrize("tap", [tcp_tap, pty_tap])
def test_it_writes_what_passes_and_sends_nothing(
    tap: Callable[
        [],
        contextlib.AbstractContextManager[tuple[str, Callable[[bytes], None], Callable[[], bytes]]],
    ],
    tmp_path: Path,
) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    with tap() as (port, say, came):
        running = listen_to(port, fifo, "slink3")
        pipe = Fifo(fifo)
        pipe.packets(0)  # once the line is described, the port is open
        for piece in PIECES:
            say(piece)
        found = pipe.packets(3)
        assert came() == b""
        pipe.close()  # Wireshark has gone
        assert running.ended().status == 0
    assert [packet.data for packet in found] == HEARD
    assert [packet.comment for packet in found] == ["", "", "cut short"]
    assert all(packet.sent is None for packet in found)


def test_it_ends_when_it_is_told_to_and_keeps_what_it_had(tmp_path: Path) -> None:
    path = tmp_path / "capture.pcapng"
    with tcp_tap() as (port, say, _):
        running = listen_to(port, path, "slink3")
        say(READ.encode() + ANSWER.encode()[:5])  # the rest never comes
        until = time.monotonic() + PATIENCE
        while not (path.exists() and READ.encode() in path.read_bytes()):
            assert time.monotonic() < until
            time.sleep(0.02)
        assert running.end(signal.SIGTERM).status == 0
    packets = list(CaptureReader(path).packets())
    assert [packet.data for packet in packets] == [READ.encode(), ANSWER.encode()[:5]]


def test_a_port_that_there_is_not_is_told(tmp_path: Path) -> None:
    asked = ["--extcap-interface", "multidrop", "--port", "/dev/nothing", "--protocol", "slink3"]
    ran = multidrop("extcap", "--capture", "--fifo", str(tmp_path / "x"), *asked)
    assert ran.status == 5
    assert "no such port" in ran.err


@pytest.mark.parametrize("protocol", ["slink3", "auto"])
def test_wireshark_captures_with_it(protocol: str, tmp_path: Path) -> None:
    """Installed as a user installs it; then tshark itself finds it, runs it and dissects."""
    tshark_path()
    assert (
        multidrop(
            "wireshark", "--install", HOME=str(tmp_path), XDG_CONFIG_HOME=str(tmp_path)
        ).status
        == 0
    )
    with tcp_tap() as (port, say, came):

        def talk() -> None:
            with contextlib.suppress(OSError):  # tshark has its packets and goes
                for piece in PIECES * 3:
                    say(piece)
                    time.sleep(0.05)

        talking = threading.Thread(target=talk, daemon=True)
        talking.start()
        options = ["-T", "fields", "-e", info_field(), "-c", "2"]
        chosen = [
            "-o",
            f"extcap.multidrop.port:{port}",
            "-o",
            f"extcap.multidrop.protocol:{protocol}",
        ]
        out = tshark("-i", "multidrop", *chosen, *options, home=tmp_path)
        talking.join(PATIENCE)
        assert came() == b""
    assert out.splitlines() == [
        "2 #1 read typed parameter 8236:auto",
        "2 #1 OK 8236:int16 = 7",
    ]


# -- where it goes ---------------------------------------------------------------------------------------


def test_where_the_files_go_follows_what_wireshark_says(tmp_path: Path) -> None:
    new = {
        "personal lua plugins": "/l",
        "personal extcap path": "/e",
        "personal configuration": "/c",
    }
    assert wireshark._named(new, "w").files == (Path("/l/multidrop.lua"), Path("/e/multidrop"))
    del new["personal extcap path"]
    assert wireshark._named(new, "w").extcap == Path("/c/extcap")
    assert wireshark._named({}, None).extcap == Path("~/.local/lib/wireshark/extcap").expanduser()


def test_install_writes_two_files_and_runs(tmp_path: Path) -> None:
    where = wireshark.Folders(tmp_path / "lua", tmp_path / "extcap")
    wireshark.install(where)
    wireshark.install(where)  # again, over its own
    dissector, program = where.files
    assert dissector.read_text("utf-8") == wireshark.DISSECTOR.read_text("utf-8")
    running = Running(str(program), "--extcap-interfaces")
    assert "interface {value=multidrop}" in running.ended().out


def test_install_leaves_what_is_not_ours(tmp_path: Path) -> None:
    where = wireshark.Folders(tmp_path, tmp_path / "extcap")
    where.extcap.mkdir()
    where.files[1].write_text("#!/bin/sh\n")
    with pytest.raises(UsageError, match="left as it is"):
        wireshark.install(where)
    assert not where.files[0].exists()


def test_without_install_nothing_is_written(tmp_path: Path) -> None:
    shown = multidrop("wireshark", HOME=str(tmp_path), XDG_CONFIG_HOME=str(tmp_path))
    assert shown.status == 0
    assert "nothing was written" in shown.out
    fields = multidrop(
        "wireshark", "--json", HOME=str(tmp_path), XDG_CONFIG_HOME=str(tmp_path)
    ).object
    assert Path(fields["shipped"]).is_file()
    assert not Path(fields["dissector"]).exists()
    assert fields["installed"] is False
