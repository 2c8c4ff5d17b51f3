"""A serial device server behind a network that takes baud rate, format and pins: RFC 2217."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

import multidrop
from integration.processes import multidrop as command
from integration.processes import simulator
from integration.rfc2217_server import SerialServer, serial_server
from integration.servers import answering
from integration.ways import Way
from multidrop import PortError, UsageError


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SerialServer]:
    link = tmp_path_factory.mktemp("rfc2217") / "drive"
    with (
        simulator("flexmax:0+dgfc386", "ax-v:2", listen=f"pty:{link}"),
        serial_server(str(link)) as started,
    ):
        yield started


def test_reads_and_writes(server: SerialServer, way: Way) -> None:
    written, found, status = way(
        f"flexmax:0@{server.port}",
        ("write", "8236", 1234),
        ("read", "8236"),
        ("status",),
    )
    assert written.outcome == "confirmed"
    assert found.value == 1234
    assert status.fields["state"] == "switch-on disabled"


@pytest.mark.parametrize("value", [-1, -256, 255])
def test_bytes_ff_are_data_on_a_telnet_line(server: SerialServer, way: Way, value: int) -> None:
    _, found = way(f"flexmax:0@{server.port}", ("write", "8236", value), ("read", "8236"))
    assert found.value == value


def test_special_access_full_of_telnet_commands(server: SerialServer, way: Way) -> None:
    data = bytes.fromhex("FF FD 2C FF FF FA 2C FF F0 FF 00 0D 0A 0D 00")
    (report,) = way(f"flexmax:0@{server.port}", ("raw", f"dgfc/CDAB {data.hex()}"))
    assert bytes.fromhex(report.fields["data"]) == data


@pytest.mark.parametrize(
    ("keys", "settings"),
    [
        ("", (9600, 8, "E", 1)),
        (",baud=19200,format=7O2", (19200, 7, "O", 2)),
        (",format=8N1", (9600, 8, "N", 1)),
    ],
)
def test_the_settings_reach_the_server(
    server: SerialServer, way: Way, keys: str, settings: tuple[object, ...]
) -> None:
    assert way(f"ax-v:2@{server.port}{keys}", ("read", "1009"))[0].value == 125
    assert server.settings == settings


@pytest.mark.parametrize(
    ("keys", "pins"),
    [
        ("", {"rts": True, "dtr": True}),
        (",rts=off,dtr=off", {"rts": False, "dtr": False}),
        (",rts=off,dtr=on", {"rts": False, "dtr": True}),
        (",rts=leave,dtr=leave", {}),
    ],
)
def test_the_pins_are_set_or_left(
    server: SerialServer, way: Way, keys: str, pins: dict[str, bool]
) -> None:
    server.serial.pins.clear()
    found = {}
    if way.__name__ == "blocking":
        with multidrop.connect(f"ax-v:2@{server.port}{keys}") as drive:
            drive.read("1009")
            found = dict(server.serial.pins)
    else:
        found = asyncio.run(_pins_while_open(server, keys))
    assert found == pins


async def _pins_while_open(server: SerialServer, keys: str) -> dict[str, bool]:
    async with multidrop.connect_async(f"ax-v:2@{server.port}{keys}") as drive:
        await drive.read("1009")
        return dict(server.serial.pins)


def test_the_server_hangs_up(server: SerialServer) -> None:
    with multidrop.connect(f"ax-v:2@{server.port}") as drive:
        assert drive.read("1009").value == 125
        server.hang_up()
        for _ in range(2):
            with pytest.raises(PortError, match="was lost"):
                drive.read("1009")


def test_the_server_hangs_up_in_asyncio(server: SerialServer) -> None:
    async def hang_up() -> None:
        async with multidrop.connect_async(f"ax-v:2@{server.port}") as drive:
            assert (await drive.read("1009")).value == 125
            server.hang_up()
            for _ in range(2):
                with pytest.raises(PortError, match="was lost"):
                    await drive.read("1009")

    asyncio.run(hang_up())


def test_nobody_listens(way: Way) -> None:
    with pytest.raises(PortError, match=r"rfc2217://127\.0\.0\.1:1: connection refused"):
        way("ax-v:2@rfc2217://127.0.0.1:1", ("read", "1009"))


def test_a_server_that_speaks_no_rfc2217(way: Way, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("multidrop.io.ports.CONNECT_TIMEOUT", 0.1)
    monkeypatch.setattr("multidrop.io.async_line.CONNECT_TIMEOUT", 0.1)
    with answering(lambda request: None) as raw:
        port = raw.port.replace("tcp", "rfc2217")
        with pytest.raises(PortError, match=r"no RFC 2217 answer within 0\.1 s .*tcp://HOST:PORT"):
            way(f"ax-v:2@{port}", ("read", "1009"))


@pytest.mark.parametrize("port", ["rfc2217://", "rfc2217://host", "rfc2217://host:99999"])
def test_an_address_that_is_none(port: str, way: Way) -> None:
    with pytest.raises(UsageError):
        way(f"ax-v:2@{port}", ("read", "1009"))


def test_the_kernel_here_cannot_switch_a_transmitter_there(server: SerialServer, way: Way) -> None:
    with pytest.raises(PortError, match="direction=kernel needs a serial port of this machine"):
        way(f"ax-v:2@{server.port},direction=kernel", ("read", "1009"))


def test_from_the_command_line(server: SerialServer, tmp_path: Path) -> None:
    ran = command("read", f"ax-v:2@{server.port}", "1009", "--json", cwd=tmp_path)
    assert ran.status == 0
    assert ran.object["value"] == 125
    assert ran.object["device"] == f"ax-v:2@{server.port}"
