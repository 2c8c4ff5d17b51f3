"""The Modbus server of the gateway: with pymodbus' client, with mbpoll, and with bare bytes."""

from __future__ import annotations

import asyncio
import contextlib
import re
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest
from programs import program
from pymodbus.client import AsyncModbusTcpClient

from integration.processes import PATIENCE
from integration.published import Published, published, ran
from integration.writes import logged
from multidrop.catalog import load_profile
from multidrop.errors import PortError, UsageError
from multidrop.gateway.modbus import part as modbus
from multidrop.gateway.modbus.part import ModbusServer
from multidrop.plantfile import parse_plant
from multidrop.sim.slink3 import ax_v

TABLES = '[modbus]\nlisten = "127.0.0.1:0"\nwrites = true\n'
TORQUE, SPEED, TENSION, MISSING = 0, 1, 100, 102
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, FAILURE, BUSY, NO_REPLY = 1, 2, 3, 4, 6, 11


@contextlib.asynccontextmanager
async def served(
    folder: Path, tables: str = TABLES
) -> AsyncIterator[tuple[Published, ModbusServer]]:
    """A gateway whose Modbus server listens, and whose points have been read once."""
    async with published(folder, tables) as site:
        server = site.gateway.parts["modbus"]
        assert isinstance(server, ModbusServer)
        await site.until(lambda: bool(server.port))
        await site.until_value("infeed", "torque", 0)
        await site.until_value("infeed", "bus_address", 0)
        await site.until_value("unwinder", "tension", 12.5)
        yield site, server


@contextlib.asynccontextmanager
async def client(server: ModbusServer) -> AsyncIterator[AsyncModbusTcpClient]:
    host, _, number = server.port.rpartition(":")
    made = AsyncModbusTcpClient(host, port=int(number), timeout=PATIENCE, retries=0)
    assert await made.connect()
    try:
        yield made
    finally:
        made.close()


class Bare:
    """A client that sends any bytes. An answer is its number, function and data."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    def send(self, number: int, message: bytes, unit: int = 1) -> None:
        self.writer.write(struct.pack(">HHHB", number, 0, 1 + len(message), unit) + message)

    async def answer(self) -> tuple[int, bytes]:
        async with asyncio.timeout(PATIENCE):
            number, protocol, size = struct.unpack(">HHH", await self.reader.readexactly(6))
            assert protocol == 0
            return number, (await self.reader.readexactly(size))[1:]

    async def ask(self, message: bytes) -> bytes:
        self.send(9, message)
        number, answer = await self.answer()
        assert number == 9
        return answer

    async def is_cut_off(self) -> bool:
        async with asyncio.timeout(PATIENCE):
            try:
                return await self.reader.read() == b""
            except ConnectionResetError:
                return True


@contextlib.asynccontextmanager
async def bare(server: ModbusServer) -> AsyncIterator[Bare]:
    host, _, number = server.port.rpartition(":")
    reader, writer = await asyncio.open_connection(host, int(number))
    try:
        yield Bare(reader, writer)
    finally:
        writer.close()
        with contextlib.suppress(ConnectionError):
            await writer.wait_closed()


def run(
    folder: Path, test: Callable[[Published, ModbusServer], Awaitable[None]], tables: str = TABLES
) -> None:
    async def main() -> None:
        async with served(folder, tables) as (site, server):
            await test(site, server)

    asyncio.run(main())


def test_words_and_floats_are_read(tmp_path: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        assert (tmp_path / "registers.csv").read_text().splitlines() == [
            "register,type,device,point",
            "0,int16,infeed,torque",
            "1,int16,infeed,speed",
            "2,uint16,infeed,bus_address",
            "100,float32,unwinder,tension",
            "102,int16,unwinder,missing",
        ]
        assert site.said == [f"modbus on {server.port}"]
        async with client(server) as one:
            for read in (one.read_holding_registers, one.read_input_registers):
                assert (await read(TORQUE, count=3)).registers == [0, 0, 0]
                registers = (await read(TENSION, count=2)).registers
                assert struct.pack(">HH", *registers) == struct.pack(">f", 12.5)

    run(tmp_path, check)


def test_a_write_is_answered_when_the_drive_has_it(tmp_path: Path, audit: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        site.answer_delay(0.1)
        async with client(server) as one:
            began = asyncio.get_running_loop().time()
            answer = await one.write_register(TORQUE, 0x10000 - 123)
            took = asyncio.get_running_loop().time() - began
            assert not answer.isError()
            assert answer.registers == [0x10000 - 123]
            assert took > 0.3  # old value, write, read-back
            line = logged(audit)[-1]
            assert (line["old"], line["asked"], line["found"]) == (0, -123, -123)
            assert (line["outcome"], line["who"]) == ("confirmed", "modbus client")
            assert re.fullmatch(r"modbus 127\.0\.0\.1:\d+", line["from"])
            await site.until_value("infeed", "torque", -123)
            assert (await one.read_holding_registers(TORQUE)).registers == [0x10000 - 123]

            registers = list(struct.unpack(">HH", struct.pack(">f", 0.1)))
            assert not (await one.write_registers(TENSION, registers)).isError()
            assert logged(audit)[-1]["asked"] == 0.1
            await site.until_value("unwinder", "tension", 0.1)

    run(tmp_path, check)


def test_what_is_not_good_is_never_given(tmp_path: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        drive = site.line.devices[0]
        async with client(server) as one:
            await site.until_said("unwinder", "missing", "refused")
            assert (await one.read_holding_registers(MISSING)).exception_code == NO_REPLY
            assert (await one.read_holding_registers(TENSION, count=3)).exception_code == NO_REPLY
            assert not (await one.read_holding_registers(TENSION, count=2)).isError()

            site.line.devices.remove(drive)
            await site.until_said("infeed", "torque", "no reply")
            assert (await one.read_holding_registers(TORQUE)).exception_code == NO_REPLY
            site.line.devices.append(drive)
            await site.gateway.line_of("infeed").service.try_now("infeed")
            await site.until_value("infeed", "torque", 0)
            assert (await one.read_holding_registers(TORQUE)).registers == [0]

    run(tmp_path, check)


def test_a_write_that_fails_says_how(tmp_path: Path, audit: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        async with client(server) as one:
            # beyond what the plant allows, beyond what the drive takes, not to be written at all
            assert (await one.write_register(TORQUE, 1501)).exception_code == ILLEGAL_VALUE
            assert logged(audit)[-1]["outcome"] == "not-sent"
            assert (await one.write_register(MISSING, 300)).exception_code == FAILURE
            assert (await one.write_register(SPEED, 5)).exception_code == ILLEGAL_ADDRESS
            assert logged(audit)[-1]["error"].startswith("infeed speed may not be written")
            nan = list(struct.unpack(">HH", struct.pack(">f", float("nan"))))
            assert (await one.write_registers(TENSION, nan)).exception_code == ILLEGAL_VALUE

            site.line.devices.clear()
            assert (await one.write_register(TORQUE, 5)).exception_code == NO_REPLY
            assert [line["outcome"] for line in logged(audit)].count("confirmed") == 0
            assert len(logged(audit)) == 5

    run(tmp_path, check)


def test_writes_are_off_unless_the_plant_says_so(tmp_path: Path, audit: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        async with client(server) as one:
            assert (await one.write_register(TORQUE, 5)).exception_code == ILLEGAL_FUNCTION
        (line,) = logged(audit)
        assert line["outcome"] == "not-sent"
        assert line["error"] == "[modbus] has no writes = true"

    run(tmp_path, check, '[modbus]\nlisten = "127.0.0.1:0"\n')


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("03 0003 0001", ILLEGAL_ADDRESS),  # no point there
        ("03 0064 0001", ILLEGAL_ADDRESS),  # half a float
        ("03 0065 0001", ILLEGAL_ADDRESS),
        ("03 0002 0002", ILLEGAL_ADDRESS),  # a point, and nothing behind it
        ("03 FFFF 0002", ILLEGAL_ADDRESS),
        ("03 0000 0000", ILLEGAL_VALUE),
        ("03 0000 007E", ILLEGAL_VALUE),
        ("03 0000", ILLEGAL_VALUE),
        ("04 0000 0001 00", ILLEGAL_VALUE),
        ("06 0064 0001", ILLEGAL_ADDRESS),  # half a float
        ("06 0003 0001", ILLEGAL_ADDRESS),
        ("06 0000", ILLEGAL_VALUE),
        ("10 0000 0002 04 0001 0001", ILLEGAL_ADDRESS),  # two points in one write
        ("10 0000 0001 04 0001 0001", ILLEGAL_VALUE),
        ("10 0000 0001 02 00", ILLEGAL_VALUE),
        ("10 0000 0001 02", ILLEGAL_VALUE),
        ("10 0000 0000 00", ILLEGAL_VALUE),
        ("10 0000", ILLEGAL_VALUE),
        ("01 0000 0001", ILLEGAL_FUNCTION),
        ("05 0000 FF00", ILLEGAL_FUNCTION),
        ("16 0000 00F2 0025", ILLEGAL_FUNCTION),
        ("17 0000 0001 0000 0001 02 00FF", ILLEGAL_FUNCTION),
        ("2B 0E 01 00", ILLEGAL_FUNCTION),
        ("08 0004 0000", ILLEGAL_FUNCTION),
        ("00", ILLEGAL_FUNCTION),
        ("7F", ILLEGAL_FUNCTION),
    ],
)
def test_what_is_not_right_is_refused_and_nothing_is_written(
    tmp_path: Path, audit: Path, message: str, code: int
) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        request = bytes.fromhex(message)
        async with bare(server) as one:
            assert await one.ask(request) == bytes((request[0] | 0x80, code))
            assert await one.ask(bytes.fromhex("03 0000 0001")) == bytes.fromhex("03 02 0000")
        assert logged(audit) == []

    run(tmp_path, check)


def test_what_is_no_modbus_ends_the_connection_and_no_other(tmp_path: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        other_protocol = bytes.fromhex("0001 0001 0006 01 03 0000 0001")
        heads = (
            other_protocol,
            b"GET / HTTP/1.1\r\n\r\n",
            bytes.fromhex("0001 0000 0001 01"),
            b"\0\1\0\0\0\xff\1",
        )
        async with bare(server) as other:
            for head in heads:
                async with bare(server) as one:
                    one.writer.write(head)
                    assert await one.is_cut_off()
            assert await other.ask(bytes.fromhex("03 0000 0001")) == bytes.fromhex("03 02 0000")

    run(tmp_path, check)


def test_requests_one_behind_the_other_get_their_own_answers(tmp_path: Path, audit: Path) -> None:
    """In one piece or byte by byte, around a write that takes its time, and from any unit."""

    async def check(site: Published, server: ModbusServer) -> None:
        site.answer_delay(0.05)
        async with bare(server) as one:
            one.send(1, bytes.fromhex("03 0064 0002"))
            one.send(2, bytes.fromhex("06 0000 0007"), unit=255)
            one.send(3, bytes.fromhex("03 0003 0001"), unit=0)
            answers = [await one.answer() for _ in range(3)]
            assert answers == [
                (1, bytes.fromhex("03 04 41480000")),
                (2, bytes.fromhex("06 0000 0007")),
                (3, bytes.fromhex("83 02")),
            ]
            for byte in bytes.fromhex("0004 0000 0006 01 03 0064 0002"):
                one.writer.write(bytes((byte,)))
                await one.writer.drain()
                await asyncio.sleep(0)
            assert await one.answer() == (4, bytes.fromhex("03 04 41480000"))
        assert [line["outcome"] for line in logged(audit)] == ["confirmed"]

    run(tmp_path, check)


def test_a_write_that_waited_too_long_is_not_begun(
    tmp_path: Path, audit: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A client that has long given up must not move anything any more."""
    monkeypatch.setattr(modbus, "WRITE_WITHIN", 0.2)

    async def check(site: Published, server: ModbusServer) -> None:
        site.answer_delay(0.15)
        async with bare(server) as one:
            one.send(1, bytes.fromhex("06 0000 0007"))
            one.send(2, bytes.fromhex("06 0000 0008"))
            assert await one.answer() == (1, bytes.fromhex("06 0000 0007"))
            assert await one.answer() == (2, bytes((0x86, BUSY)))
        assert [line["outcome"] for line in logged(audit)] == ["confirmed", "not-sent"]
        assert logged(audit)[1]["error"].startswith("it has waited here for 0.")

    run(tmp_path, check)


def test_what_a_client_still_wanted_goes_with_it(tmp_path: Path, audit: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        site.answer_delay(0.1)
        async with bare(server) as one:
            one.send(1, bytes.fromhex("06 0000 0007"))
            one.send(2, bytes.fromhex("06 0000 0008"))
            await site.until(lambda: site.gateway.line_of("infeed").service.counters.requests > 0)
        await site.until_value("infeed", "torque", 7)
        await site.until(lambda: not server.clients)
        assert [line["asked"] for line in logged(audit)] == [7]

    run(tmp_path, check)


def test_a_client_that_floods_is_cut_off(tmp_path: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        site.answer_delay(0.05)
        async with bare(server) as one, bare(server) as other:
            for number in range(modbus.MOST_WAITING + 2):
                one.send(number, bytes.fromhex("06 0000 0007"))
            assert await one.is_cut_off()
            assert await other.ask(bytes.fromhex("03 0064 0002"))

    run(tmp_path, check)


def test_a_point_that_is_gone_while_it_is_written_is_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reload may take it away between the request and what came of it."""

    async def check(site: Published, server: ModbusServer) -> None:
        async def gone(*_: object, **__: object) -> None:
            await site.gateway.reload(other)
            assert server.map.covering(0, 1) is not None
            raise UsageError("infeed has no point 'torque'")

        text = site.text.replace("torque =", "moment =").format(port=site.port)
        other = parse_plant(text, site.file, load_profile)
        monkeypatch.setattr(site.gateway, "write", gone)
        async with bare(server) as one:
            assert await one.ask(bytes.fromhex("06 0000 0007")) == b"\x86\x02"

    run(tmp_path, check)


def test_a_fault_of_the_server_does_not_leave_a_client_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def broken(server: ModbusServer, request: modbus.Request, client: str) -> None:
        raise OSError("a bug")

    monkeypatch.setattr(ModbusServer, "execute", broken)

    async def check(site: Published, server: ModbusServer) -> None:
        async with bare(server) as one:
            one.send(1, bytes.fromhex("03 0064 0002"))
            assert await one.is_cut_off()

    run(tmp_path, check)


def test_a_client_that_was_silent_for_long_makes_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that was unplugged never says so: it must not keep its place for ever."""
    monkeypatch.setattr(modbus, "MOST_CLIENTS", 2)
    monkeypatch.setattr(modbus, "SILENT", 0.2)

    async def check(site: Published, server: ModbusServer) -> None:
        async with bare(server) as silent, bare(server) as busy:
            assert await silent.ask(bytes.fromhex("03 0000 0001"))
            await asyncio.sleep(0.3)
            assert await busy.ask(bytes.fromhex("03 0000 0001"))
            async with bare(server) as new:
                assert await new.ask(bytes.fromhex("03 0000 0001"))
                assert await silent.is_cut_off()
                assert await busy.ask(bytes.fromhex("03 0000 0001"))

    run(tmp_path, check)


def test_a_client_too_many_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modbus, "MOST_CLIENTS", 1)

    async def check(site: Published, server: ModbusServer) -> None:
        async with bare(server) as one:
            assert await one.ask(bytes.fromhex("03 0000 0001"))
            async with bare(server) as other:
                assert await other.is_cut_off()
            assert await one.ask(bytes.fromhex("03 0000 0001"))

    run(tmp_path, check)


def test_a_reload_adds_points_and_moves_none(tmp_path: Path) -> None:
    more = '[line.press.device.third]\nprofile = "ax-v"\naddress = 3\n'
    point = '[line.press.device.third.points]\nextra = { at = "1009:int16", every = 0.1 }\n'

    async def check(site: Published, server: ModbusServer) -> None:
        before = (tmp_path / "registers.csv").read_text()
        site.line.devices.append(ax_v(3))
        async with client(server) as one:
            await site.gateway.reload(site.plant(more + point))
            await site.until_value("third", "extra", 125)
            assert (await one.read_holding_registers(200)).registers == [125]
            assert (tmp_path / "registers.csv").read_text() == before + "200,int16,third,extra\n"
            await site.gateway.reload(site.plant())
            assert (await one.read_holding_registers(200)).exception_code == ILLEGAL_ADDRESS
            assert (await one.read_holding_registers(TENSION, count=2)).registers

    run(tmp_path, check)


def test_writes_from_other_machines_are_warned_of(tmp_path: Path) -> None:
    async def said(*more: str) -> list[str]:
        text = "\n".join(["[modbus]", 'listen = "0.0.0.0:0"', *more, ""])
        async with published(tmp_path, text) as site:
            server = site.gateway.parts["modbus"]
            assert isinstance(server, ModbusServer)
            await site.until(lambda: bool(server.port))
            return [text.replace(server.port, "PORT") for text in site.said]

    warned = "modbus: whoever reaches PORT may write: it has no passwords"
    assert asyncio.run(said("writes = true")) == ["modbus on PORT", warned]
    assert asyncio.run(said()) == ["modbus on PORT"]


def test_an_address_that_is_taken_ends_the_gateway(tmp_path: Path) -> None:
    async def check(site: Published, server: ModbusServer) -> None:
        (tmp_path / "second").mkdir()
        tables = f'[modbus]\nlisten = "{server.port}"\n'
        with pytest.raises(PortError, match="cannot listen on"):
            async with published(tmp_path / "second", tables) as second:
                await second.gateway.run()

    run(tmp_path, check)


def test_mbpoll_reads_and_writes(tmp_path: Path) -> None:
    mbpoll = program("mbpoll", "make mbpoll")

    async def check(site: Published, server: ModbusServer) -> None:
        host, _, port = server.port.rpartition(":")

        async def poll(*arguments: str, values: tuple[str, ...] = ()) -> tuple[int, str]:
            return await ran(mbpoll, "-0", "-1", "-p", port, *arguments, host, *values)

        status, out = await poll("-t", "4:float", "-B", "-r", str(TENSION))
        assert status == 0
        assert re.search(r"\[100\]:\s+12\.5", out), out
        status, out = await poll("-t", "4", "-r", str(TORQUE), values=("321",))
        assert (status, "Written 1 references" in out) == (0, True), out
        await site.until_value("infeed", "torque", 321)
        status, out = await poll("-t", "3", "-r", str(TORQUE), "-c", "3")
        assert re.search(r"\[0\]:\s+321", out), out
        status, out = await poll("-t", "4", "-r", str(MISSING))
        assert "Target device failed to respond" in out

    run(tmp_path, check)
