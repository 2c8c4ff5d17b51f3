"""An asyncio line: turns, cancellation, loss and closing, in virtual time."""

from __future__ import annotations

import asyncio

import pytest
from integration.virtual_time import WireTransport

from multidrop.errors import NoReply, PortError, UsageError
from multidrop.io.async_line import AsyncLine, open_async_line
from multidrop.io.parity import ParityMarks
from multidrop.io.turns import Priority
from multidrop.naming import LineOptions
from multidrop.protocols import datalink, slink3
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault
from multidrop.sim.line import Pace, SimulatedLine
from unit.io.lines import (
    AX,
    DRIVE,
    INT,
    OTHER,
    asyncio_line,
    in_virtual_time,
    scripted,
    simulated,
)


def test_the_time_of_an_answer() -> None:
    async def main() -> None:
        line = asyncio_line(simulated(faults=scripted(Fault.LATE_ANSWER, late=0.25)))
        timed = await line.timed(AX.read_typed(1009, INT))
        assert timed.result.value == 125
        assert timed.seconds == pytest.approx(0.25, abs=1e-6)

    in_virtual_time(main)


def test_many_tasks_take_turns() -> None:
    async def main() -> None:
        line = asyncio_line(simulated(pace=Pace(11 / 9600)))
        finished: list[int] = []

        async def write(number: int) -> None:
            await line.run(
                (DRIVE, OTHER, AX)[number % 3].read_typed(1009 if number % 3 == 2 else 8236, INT)
            )
            finished.append(number)

        started = asyncio.get_running_loop().time()
        await asyncio.gather(*(write(number) for number in range(12)))
        assert finished == list(range(12))
        elapsed = asyncio.get_running_loop().time() - started
        assert elapsed == pytest.approx(12 * 24 * 11 / 9600 + 11 * 0.002, abs=1e-4)
        assert line.counters.answers == 12
        assert line.counters.foreign == 0

    in_virtual_time(main)


def test_one_that_is_cancelled_leaves_the_line_to_the_next() -> None:
    async def main() -> None:
        line = asyncio_line(simulated(faults=scripted(Fault.LATE_ANSWER, late=0.5)))
        first = asyncio.ensure_future(line.run(DRIVE.write_typed(8236, INT, 1)))
        second = asyncio.ensure_future(line.run(DRIVE.read_typed(8236, INT)))
        await asyncio.sleep(0.1)
        first.cancel()
        with pytest.raises(asyncio.CancelledError):
            await first
        assert line.acted
        assert (await second).value == 1
        assert not line.acted
        await asyncio.sleep(1.0)
        assert line.counters.foreign == 1  # the late OK

    in_virtual_time(main)


def test_one_that_is_cancelled_before_its_turn_has_sent_nothing() -> None:
    async def main() -> None:
        line = asyncio_line(simulated(faults=scripted(Fault.LATE_ANSWER, late=0.5)))
        first = asyncio.ensure_future(line.run(DRIVE.write_typed(8236, INT, 1)))
        second = asyncio.ensure_future(line.run(DRIVE.write_typed(8236, INT, 2)))
        await asyncio.sleep(0.1)
        second.cancel()
        with pytest.raises(asyncio.CancelledError):
            await second
        assert not line.acted
        await first
        assert line.acted
        assert line.counters.requests == 1

    in_virtual_time(main)


def test_the_number_of_what_was_cancelled_rests() -> None:
    """Sixteen numbers come round in a fraction of a second: the one in flight is left out."""

    async def main() -> None:
        line = asyncio_line(simulated(faults=scripted(Fault.NO_ANSWER)))
        numbers: list[int] = []
        line.taps.append(
            lambda data, out, now, damaged: numbers.append(data[2] >> 2) if out else None
        )
        task = asyncio.ensure_future(line.run(DRIVE.write_typed(8236, INT, 1)))
        await asyncio.sleep(0.01)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        for _ in range(16):
            await line.run(DRIVE.read_typed(8236, INT))
        assert numbers == [0, *range(1, 16), 1]

    in_virtual_time(main)


def test_a_line_that_is_lost_in_the_middle() -> None:
    async def main() -> None:
        line = asyncio_line(simulated(faults=scripted(Fault.NO_ANSWER)))
        waiting = [asyncio.ensure_future(line.run(DRIVE.read_typed(8236, INT))) for _ in range(3)]
        await asyncio.sleep(0.1)
        line.connection_lost(OSError("unplugged"))
        for task in waiting:
            with pytest.raises(PortError, match="the port was lost: unplugged"):
                await task
        with pytest.raises(PortError, match="unplugged"):
            await line.run(DRIVE.read_typed(8236, INT))

    in_virtual_time(main)


class Broken(asyncio.WriteTransport):
    """A transport that cannot write any more, and has not told so yet."""

    def write(self, data: object) -> None:
        raise OSError("device disconnected")

    def close(self) -> None:
        pass


def test_a_port_that_breaks_while_it_is_written_to() -> None:
    async def main() -> None:
        line = AsyncLine(slink3.LINE, LineOptions(), name="/dev/x")
        line.connection_made(Broken())
        for _ in range(2):
            with pytest.raises(PortError, match="/dev/x was lost: device disconnected"):
                await line.run(DRIVE.broadcast_typed(8236, INT, 1))

    in_virtual_time(main)


def test_closing_waits_until_the_port_is_free() -> None:
    async def main() -> None:
        line = asyncio_line(simulated(faults=scripted(Fault.NO_ANSWER)))
        waiting = asyncio.ensure_future(line.run(DRIVE.read_typed(8236, INT)))
        await asyncio.sleep(0.1)
        await line.close()
        assert line._gone.is_set()
        with pytest.raises(PortError, match="was closed"):
            await waiting
        with pytest.raises(PortError, match="was closed"):
            await line.run(DRIVE.read_typed(8236, INT))
        await line.close()

    in_virtual_time(main)


def test_closing_what_was_never_opened() -> None:
    async def main() -> None:
        async with AsyncLine(slink3.LINE):
            pass

    in_virtual_time(main)


def test_marks_of_a_serial_port() -> None:
    async def main() -> None:
        line = asyncio_line(simulated(faults=scripted(*[Fault.NO_ANSWER] * 3)))
        line.marks = ParityMarks()
        seen: list[tuple[bytes, bool]] = []
        line.taps.append(
            lambda data, out, now, damaged: None if out else seen.append((data, damaged))
        )
        reading = asyncio.ensure_future(line.run(DRIVE.read_typed(8236, INT)))
        await asyncio.sleep(0.01)
        line.data_received(b"\x01\xff")
        line.data_received(b"\x00\x55\xff\xff")
        with pytest.raises(NoReply) as caught:
            await reading
        assert seen == [(b"\x01", False), (b"\x55", True), (b"\xff", False)]
        assert b"\x55" in caught.value.damaged

    in_virtual_time(main)


def test_strays_between_two_exchanges() -> None:
    async def main() -> None:
        line = asyncio_line()
        line.data_received(bytes.fromhex("01 02 00 0D 01 00 00 03 F1 03 63 00 9C"))
        assert (await line.run(AX.read_typed(1009, INT))).value == 125
        assert line.counters.foreign == 1

    in_virtual_time(main)


def test_nothing_is_opened_where_the_options_are_wrong() -> None:
    async def main() -> None:
        with pytest.raises(PortError, match="direction=kernel"):
            await open_async_line("tcp://h:1", slink3.LINE, direction="kernel")
        with pytest.raises(UsageError, match="tcp://HOST:PORT"):
            await open_async_line("tcp://h", slink3.LINE)

    in_virtual_time(main)


def test_a_write_goes_before_a_poll() -> None:
    async def main() -> None:
        line = asyncio_line(simulated(pace=Pace(11 / 9600)))
        finished: list[str] = []

        async def read(name: str, priority: Priority) -> None:
            await line.run(DRIVE.read_typed(8236, INT), priority, name)
            finished.append(name)

        await asyncio.gather(
            read("first", Priority.POLL),
            read("background", Priority.BACKGROUND),
            read("poll", Priority.POLL),
            read("operator", Priority.OPERATOR),
            read("write", Priority.WRITE),
        )
        assert finished == ["first", "write", "operator", "poll", "background"]

    in_virtual_time(main)


def test_an_acknowledge_is_measured() -> None:
    async def main() -> None:
        line = AsyncLine(datalink.LINE, LineOptions(), network=False)
        wire = SimulatedLine([simulated_device("53mc5000", 3)], datalink.decoder)
        WireTransport(wire.attach(), line)
        await line.run(datalink.Master(3).change(0x73E, bytes.fromhex("4B 40 08")))
        assert line.delays.number == 1
        assert 0 <= line.delays.longest < 0.001

    in_virtual_time(main)
