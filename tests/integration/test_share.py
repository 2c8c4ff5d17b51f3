"""One port and many masters, on real sockets: answers, turns, changes, and clients that misbehave."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import pytest

from integration.sharing import PATIENCE, Sharing, shared, wire
from multidrop.catalog import load_profile
from multidrop.errors import DeviceError, NoReply, PortError, UsageError
from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000
from multidrop.sim.datalink import SimulatedInstrument

FAST = 11 / 115200
"""s of a character: the line is busy, and the test is not slow."""


def run(test: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(test, PATIENCE))


# -- answers -------------------------------------------------------------------------------------

READS: dict[str, tuple[tuple[tuple[str, int], ...], dict[str, tuple[str, ...]]]] = {
    "slink3": (
        (("flexmax", 0), ("flexmax", 1), ("ax-v", 2)),
        {
            "flexmax:0": ("8511:uint16", "std/0x6041.0:uint16"),
            "flexmax:1": ("8511:uint16", "8236:int16"),
            "ax-v:2": ("1009", "1111"),
        },
    ),
    "datalink": (
        (("53mc5000", 3), ("53mc5000", 4)),
        {"53mc5000:3": ("B1", "C101", "L106"), "53mc5000:4": ("B1", "A190", "C103..C105")},
    ),
    "ultra3000": (
        (("ultra3000", 0), ("ultra3000", 1)),
        {"ultra3000:0": ("kp", "0x000", "0x05B.7"), "ultra3000:1": ("ki", "0x002", "0x05B.3")},
    ),
}


@pytest.mark.parametrize("protocol", READS)
def test_masters_at_once_each_hear_their_own_answers(protocol: str) -> None:
    """Four of them, each with other points in another order; values are those that one alone reads."""
    devices, points = READS[protocol]

    made = {}
    for name in points:  # once: a profile takes longer to read than a point
        profile, address = name.split(":")
        made[name] = PROTOCOLS[protocol].device(int(address), load_profile(profile), {})

    async def poll(sharing: Sharing, start: int, rounds: int) -> list[tuple[str, list[Any]]]:
        found = []
        everything = [(name, point) for name, texts in points.items() for point in texts]
        async with sharing.master() as line:
            for number in range(rounds * len(everything)):
                name, text = everything[(number * (start + 1) + start) % len(everything)]
                device = made[name]
                samples = await line.run(device.read_group(device.points(text)))
                found.append((name + text, [sample.raw for sample in samples]))
        return found

    async def test() -> None:
        async with shared(protocol, wire(protocol, *devices, pace=FAST)) as sharing:
            alone = dict(await poll(sharing, 0, 1))
            assert len({tuple(raws) for raws in alone.values()}) > len(alone) / 2
            found = await asyncio.gather(*(poll(sharing, start, 5) for start in range(4)))
            for one in found:
                assert all(raws == alone[what] for what, raws in one)
            assert sharing.took_turns()
            assert sharing.share.counts.answers == sharing.share.counts.requests

    run(test())


def test_the_line_has_sequence_numbers_of_its_own() -> None:
    """Two masters ask with the same number at the same time; each gets its answer with it."""

    async def ask(sharing: Sharing, index: int) -> list[slink3.Frame]:
        question = slink3.Frame(2, 0x3C, 0, 0x26, b"\x03" + index.to_bytes(2, "little")).encode()
        found = []
        async with sharing.socket() as (reader, writer):
            for _ in range(20):
                writer.write(question)
                found.append(slink3.Frame.decode(await reader.readexactly(13)))
        return found

    async def test() -> None:
        async with shared("slink3", wire("slink3", ("ax-v", 2), pace=FAST)) as sharing:
            first, second = await asyncio.gather(ask(sharing, 1009), ask(sharing, 1111))
        assert {frame.control for frame in first + second} == {0x3C}
        assert {frame.data for frame in first} == {b"\x03\xf1\x03\x7d\x00"}
        assert {frame.data for frame in second} == {b"\x03\x57\x04\x64\x00"}
        asked = [frame.control for sent, frame in sharing.passed if sent]
        assert asked == [number % 16 * 4 for number in range(40)]

    run(test())


def test_a_silent_device_costs_its_client_the_answer_and_the_others_a_wait() -> None:
    async def test() -> None:
        line = wire("slink3", ("ax-v", 2))
        async with (
            shared("slink3", line, timeout="0.1") as sharing,
            sharing.master() as one,
            sharing.socket() as (reader, writer),
        ):
            writer.write(slink3.Frame(9, 0, 0, 0x23).encode())
            for _ in range(5):
                sample = await one.run(slink3.Master(2, slink3.AX_V).read_typed(1009))
                assert sample.value == 125
            asked = [frame.address for sent, frame in sharing.passed if sent]
            assert asked.count(9) == 1  # the line asks once: repeating is the client's
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(reader.read(1), 0.3)

    run(test())


# -- what may act --------------------------------------------------------------------------------


def test_a_write_is_refused_with_an_answer() -> None:
    async def test() -> None:
        line = wire("slink3", ("ax-v", 2))
        async with shared("slink3", line) as sharing, sharing.master() as master:
            with pytest.raises(DeviceError) as refused:
                await master.run(
                    slink3.Master(2, slink3.AX_V).write_typed(1111, slink3.Format.SHORT_INT, 7)
                )
            assert refused.value.code == 0x1A
            event = await sharing.told("write-refused")
            assert "write refused: 2 #0 write typed parameter 1111:int16 := 7" in event.text
            assert not sharing.passed
            counts = sharing.share.counts
            assert (counts.refused, counts.requests) == (1, 0)

    run(test())


@pytest.mark.parametrize("protocol", ["datalink", "ultra3000"])
def test_a_write_is_refused_with_silence(protocol: str) -> None:
    change: Any = {
        "datalink": datalink.Frame(datalink.Command.CHANGE, 3, 0x72F, 1, b"\x00"),
        "ultra3000": ultra3000.Frame(3, 0x06D, 1, "0001"),
    }[protocol]

    async def test() -> None:
        line = wire(protocol, ({"datalink": "53mc5000"}.get(protocol, protocol), 3))
        async with shared(protocol, line) as sharing, sharing.socket() as (reader, writer):
            writer.write(change.encode())
            await sharing.told("write-refused")
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(reader.read(1), 0.1)
            assert not sharing.passed

    run(test())


def test_a_flood_of_refused_writes_is_no_flood_of_lines() -> None:
    async def test() -> None:
        line = wire("slink3", ("ax-v", 2))
        async with shared("slink3", line) as sharing, sharing.socket() as (reader, writer):
            for _ in range(100):
                writer.write(slink3.Frame(2, 0, 0, 0x20).encode())
                assert slink3.Frame.decode(await reader.readexactly(8)).code == 0x1A
            assert sharing.share.counts.refused == 100
            assert 20 <= sharing.kinds().count("write-refused") < 60

    run(test())


def test_an_allowed_write_is_logged_with_who_wrote(tmp_path: Path) -> None:
    async def test() -> None:
        log = tmp_path / "audit.jsonl"
        line = wire("slink3", ("ax-v", 2))
        async with (
            shared("slink3", line, allow_writes=True, audit=log) as sharing,
            sharing.master() as master,
        ):
            device = slink3.Master(2, slink3.AX_V)
            await master.run(device.write_typed(1111, slink3.Format.SHORT_INT, 7))
            with pytest.raises(DeviceError):
                await master.run(device.write_typed(9999, slink3.Format.SHORT_INT, 7))
            client = (await sharing.told("client-come")).client
            assert (await master.run(device.read_typed(1111))).value == 7
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        assert [line["outcome"] for line in lines] == ["unverified", "not-applied"]
        assert {line["who"] for line in lines} == {client}
        assert {line["from"] for line in lines} == {"share"}
        assert lines[0]["device"].startswith("slink3:2@tcp://")
        assert [(line["point"], line["asked"]) for line in lines] == [
            ("1111", 7),
            ("9999", 7),
        ]

    run(test())


def test_a_write_that_never_went_out_is_not_logged(tmp_path: Path) -> None:
    """Whether the line hears itself cannot be found out: only a read was sent."""

    async def test() -> None:
        log = tmp_path / "audit.jsonl"
        line = wire("ultra3000", ("ultra3000", 0))
        async with (
            shared("ultra3000", line, allow_writes=True, audit=log, timeout="0.05") as sharing,
            sharing.socket() as (_, writer),
            sharing.master() as other,
        ):
            writer.write(ultra3000.Frame(5, 0x06D, 1, "0001").encode())
            await sharing.told("port-open")
            assert await other.run(ultra3000.Master(0).read(0x000))
            assert [frame.function for sent, frame in sharing.passed if sent] == [0, 0]
        assert log.read_text() == ""

    run(test())


def test_nothing_is_written_that_cannot_be_logged(tmp_path: Path) -> None:
    async def test() -> None:
        log = tmp_path / "folder" / "audit.jsonl"
        line = wire("slink3", ("ax-v", 2))
        async with (
            shared("slink3", line, allow_writes=True, audit=log) as sharing,
            sharing.master() as master,
        ):
            log.unlink()
            log.parent.rmdir()
            log.parent.touch()
            with pytest.raises(DeviceError, match="write not allowed"):
                await master.run(
                    slink3.Master(2, slink3.AX_V).write_typed(1111, slink3.Format.SHORT_INT, 7)
                )
            assert "cannot be written" in (await sharing.told("write-refused")).text
            assert not sharing.passed
        with pytest.raises(UsageError, match="cannot be written"):
            async with shared("slink3", line, allow_writes=True, audit=log):
                pass

    run(test())


# -- Datalink changes ----------------------------------------------------------------------------

C101 = 0x600 + 3 * 101


async def hammer(sharing: Sharing, address: int, until: asyncio.Event) -> int:
    """Read without a pause; how often."""
    count = 0
    async with sharing.master() as line:
        while not until.is_set():
            await line.run(datalink.Master(address).interrogate(0x200, 32))
            count += 1
    return count


def test_a_change_is_acknowledged_in_time_while_another_hammers(tmp_path: Path) -> None:
    async def test() -> None:
        line = wire("datalink", ("53mc5000", 3), pace=FAST)
        log = tmp_path / "audit.jsonl"
        async with (
            shared("datalink", line, allow_writes=True, audit=log) as sharing,
            sharing.master() as master,
        ):
            done = asyncio.Event()
            others = [asyncio.create_task(hammer(sharing, 3, done)) for _ in range(2)]
            for value in range(5):
                wanted = datalink.encode_real(float(value), 3)
                outcome = await master.run(datalink.Master(3).change_and_confirm(C101, wanted))
                assert outcome == "confirmed"
            done.set()
            assert min([await other for other in others]) >= 5
            frames = [frame for _, frame in sharing.passed]
            places = [at for at, frame in enumerate(frames) if frame.command == 0xA0]
            assert len(places) >= 5
            for at in places:  # nobody came between
                assert frames[at + 1].command is datalink.Command.RESPONSE
                assert frames[at + 2].command is datalink.Command.ACKNOWLEDGE
        outcomes = [json.loads(line)["outcome"] for line in log.read_text().splitlines()]
        assert outcomes == ["unverified"] * 5

    run(test())


def instrument(line: Any) -> SimulatedInstrument:
    (found,) = line.devices
    assert isinstance(found, SimulatedInstrument)
    return found


CHANGE = datalink.Frame(datalink.Command.CHANGE, 3, C101, 3, b"\x64\x00\x07")
ACKNOWLEDGE = datalink.Frame(datalink.Command.ACKNOWLEDGE, 3).encode()
MORE = datalink.Frame(datalink.Command.INTERROGATE, 3, C101, 4)


def test_an_acknowledge_of_somebody_else_does_not_pass(tmp_path: Path) -> None:
    async def test() -> None:
        line = wire("datalink", ("53mc5000", 3))
        async with (
            shared("datalink", line, allow_writes=True, audit=tmp_path / "a") as sharing,
            sharing.socket() as (_, other),
            sharing.socket() as (reader, writer),
        ):
            other.write(datalink.Frame(datalink.Command.INTERROGATE, 3, 0x200, 1).encode())
            writer.write(CHANGE.encode())
            await reader.readexactly(len(CHANGE.encode()))
            other.write(ACKNOWLEDGE)
            event = await sharing.told("not-passed")
            assert "3 acknowledge not passed: no change of this master waits for it" in event.text
            sent = [frame.command for was_sent, frame in sharing.passed if was_sent]
            assert datalink.Command.ACKNOWLEDGE not in sent

    run(test())


@pytest.mark.parametrize("leaves", [True, False])
def test_a_change_that_nobody_acknowledges_is_dropped(leaves: bool, tmp_path: Path) -> None:
    """Its master went, or said nothing for 80 ms: then the line asks something, which drops it."""

    async def test() -> None:
        line = wire("datalink", ("53mc5000", 3))
        async with (
            shared("datalink", line, allow_writes=True, audit=tmp_path / "a") as sharing,
            sharing.master() as other,
        ):
            before = await other.run(datalink.Master(3).interrogate(C101, 3))
            async with sharing.socket() as (reader, writer):
                writer.write(CHANGE.encode())
                await reader.readexactly(len(CHANGE.encode()))
                assert instrument(line).slave.pending == CHANGE
                if not leaves:
                    await asyncio.sleep(0.15)
                    writer.write(ACKNOWLEDGE)
                    await sharing.told("not-passed")
            assert await other.run(datalink.Master(3).interrogate(C101, 3)) == before
            sent = [frame for was_sent, frame in sharing.passed if was_sent]
            assert sent[1:3] == [CHANGE, MORE]
            assert instrument(line).slave.pending is None
        assert (tmp_path / "a").read_text() == ""

    run(test())


# -- SLINK3 broadcasts ---------------------------------------------------------------------------


def test_a_broadcast_is_verified_while_another_hammers(tmp_path: Path) -> None:
    """Any command clears a slave's note of a broadcast: nobody else's comes before 0028."""

    async def test() -> None:
        line = wire("slink3", ("flexmax", 0), ("flexmax", 1), pace=FAST)
        async with (
            shared("slink3", line, allow_writes=True, audit=tmp_path / "a") as sharing,
            sharing.master() as master,
        ):
            done = asyncio.Event()

            async def poll() -> None:
                async with sharing.master() as other:
                    while not done.is_set():
                        for address in (0, 1):
                            await other.run(slink3.Master(address).status_word())

            polling = asyncio.create_task(poll())
            broadcast = PROTOCOLS["slink3"].prepare_broadcast(
                load_profile("flexmax"), [("8236:int16", "77")], [0, 1], {}
            )
            found = await master.run(broadcast())
            done.set()
            await polling
            assert [(one.received, one.applied) for one in found] == [(True, True)] * 2

    run(test())


# -- clients that misbehave ----------------------------------------------------------------------


async def answers(sharing: Sharing, count: int = 3) -> None:
    """Another client is served as if nothing were."""
    async with sharing.master() as line:
        for _ in range(count):
            sample = await line.run(slink3.Master(2, slink3.AX_V).read_typed(1009))
            assert sample.value == 125


READ = slink3.Frame(2, 0, 0, 0x26, b"\x03\xf1\x03").encode()


def test_half_a_frame_never_reaches_the_line() -> None:
    async def test() -> None:
        async with shared("slink3", wire("slink3", ("ax-v", 2))) as sharing:
            async with sharing.socket() as (_, writer):
                writer.write(READ[:6])
                await writer.drain()
                await answers(sharing)
            async with sharing.socket() as (reader, writer):
                writer.write(READ[:6])
                await asyncio.sleep(0.4)  # SLINK3's silence behind a network
                writer.write(READ)
                assert len(await reader.readexactly(13)) == 13
            assert all(frame.data[1:] == b"\xf1\x03" for sent, frame in sharing.passed if sent)

    run(test())


def test_a_client_that_goes_with_its_request_on_the_wire() -> None:
    """Its answer is for nobody, and for nobody else."""

    async def test() -> None:
        line = wire("slink3", ("ax-v", 2), pace=11 / 9600)
        async with shared("slink3", line) as sharing:
            async with sharing.socket() as (_, writer):
                writer.write(slink3.Frame(2, 0, 0, 0x26, b"\x03\x57\x04").encode())
                while not sharing.passed:
                    await asyncio.sleep(0.002)
            await answers(sharing)
            await sharing.told("client-gone", 2)
            assert sharing.took_turns()
            assert sharing.share.counts.answers == 4

    run(test())


def test_a_flood_harms_only_itself() -> None:
    """A client that sends as fast as it can gets its turns; so do the others."""

    async def test() -> None:
        line = wire("slink3", ("ax-v", 2), pace=FAST)
        async with shared("slink3", line) as sharing, sharing.socket() as (_, writer):
            stop = asyncio.Event()

            async def flood() -> None:
                number = 0
                while not stop.is_set():
                    many = b"".join(
                        slink3.Frame(2, 0, 0, 0x26, bytes((3, place, number % 256))).encode()
                        for place in range(200)
                    )
                    writer.write(many)
                    number += 1
                    try:
                        await asyncio.wait_for(writer.drain(), 0.05)
                    except (TimeoutError, ConnectionError):
                        return  # it is read no further

            flooding = asyncio.create_task(flood())
            await sharing.told("client-come", 1)
            before = len(sharing.passed)
            await answers(sharing, 20)
            during = [frame for sent, frame in sharing.passed[before:] if sent]
            own = sum(frame.data[1:] == b"\xf1\x03" for frame in during)
            assert own == 20
            assert len(during) <= 3 * own
            assert any(client.paused for client in sharing.share._clients)
            stop.set()
            await flooding
            assert sharing.share.counts.dropped > 0

    run(test())


def test_what_is_no_master_is_disconnected() -> None:
    async def test() -> None:
        async with shared("slink3", wire("slink3", ("ax-v", 2))) as sharing:
            async with sharing.socket() as (reader, writer):
                headers = b"POST / HTTP/1.1\r\n" + b"X-Header: of some length\r\n" * 20 + b"\r\n"
                writer.write(headers + slink3.Frame(2, 0, 0, 0x20).encode())
                assert await reader.read() == b""
            event = await sharing.told("client-refused")
            assert "sends no frame of a protocol that is known here: disconnected" in event.text
            await answers(sharing)

    run(test())


def test_garbage_between_frames_is_skipped() -> None:
    async def test() -> None:
        async with (
            shared("slink3", wire("slink3", ("ax-v", 2))) as sharing,
            sharing.socket() as (reader, writer),
        ):
            for noise in (b"", b"\xff\x00", b"\x02" * 50):
                writer.write(noise + READ)
                assert len(await reader.readexactly(13)) == 13
            assert sharing.took_turns()

    run(test())


def test_a_client_of_another_protocol_is_told_and_disconnected() -> None:
    async def test() -> None:
        async with shared("slink3", wire("slink3", ("ax-v", 2))) as sharing:
            await answers(sharing, 1)
            async with sharing.socket() as (reader, writer):
                writer.write(ultra3000.Frame(0, 0).encode())
                assert await reader.read() == b""
            event = await sharing.told("client-refused")
            assert event.text.endswith("speaks ultra3000, and the line slink3: disconnected")
            await answers(sharing, 1)

    run(test())


def test_a_client_that_does_not_read_harms_only_itself() -> None:
    async def test() -> None:
        async with (
            shared("slink3", wire("slink3", ("ax-v", 2))) as sharing,
            sharing.socket() as (_, writer),
        ):
            for _ in range(50):
                writer.write(slink3.Frame(2, 0, 0, 0x20).encode() * 20)
            await answers(sharing, 10)

    run(test())


# -- the port ------------------------------------------------------------------------------------


def test_the_protocol_is_known_from_the_start() -> None:
    async def test() -> None:
        line = wire("slink3", ("ax-v", 2))
        async with shared("slink3", line, told=True) as sharing:
            assert sharing.kinds() == ["port-open"]
            await answers(sharing)

    run(test())


@pytest.mark.parametrize("told", [True, False])
def test_a_port_that_is_not_there(told: bool) -> None:
    async def test() -> None:
        with pytest.raises(PortError, match="connection refused"):
            async with shared("slink3", "tcp://127.0.0.1:1", told=told):
                pass

    run(test())


def test_a_port_that_is_lost_and_comes_back() -> None:
    """Clients stay and hear nothing; what they asked meanwhile is not sent later."""

    async def test() -> None:
        held: list[asyncio.StreamWriter] = []
        heard: list[bytes] = []

        async def device(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            held.append(writer)
            while data := await reader.read(100):
                heard.append(data)
                question = slink3.Frame.decode(data)
                found = slink3.Frame(2, question.control, 1, 0, question.data + b"\x7d\x00")
                writer.write(found.encode())
            writer.close()

        server = await asyncio.start_server(device, "127.0.0.1", 0)
        host, number = server.sockets[0].getsockname()
        async with (
            shared("slink3", f"tcp://{host}:{number}", told=True) as sharing,
            sharing.socket() as (reader, writer),
        ):
            writer.write(READ)
            assert len(await reader.readexactly(13)) == 13
            server.close()
            held[-1].close()
            event = await sharing.told("port-lost")
            assert "clients hear nothing until it is back" in event.text
            writer.write(slink3.Frame(2, 0, 0, 0x23).encode())
            await asyncio.sleep(0.05)
            server = await asyncio.start_server(device, host, number)
            await sharing.told("port-open", 2)
            writer.write(READ)
            assert len(await reader.readexactly(13)) == 13
            assert [slink3.Frame.decode(data).code for data in heard] == [0x26, 0x26]
            assert sharing.share.counts.dropped == 1
        server.close()

    run(test())


def test_a_port_that_is_lost_with_a_request_on_the_wire() -> None:
    async def test() -> None:
        async def rude(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reader.read(100)
            writer.close()

        server = await asyncio.start_server(rude, "127.0.0.1", 0)
        host, number = server.sockets[0].getsockname()
        async with (
            shared("slink3", f"tcp://{host}:{number}", told=True) as sharing,
            sharing.master() as master,
        ):
            with pytest.raises(NoReply):
                await master.run(_once())
            await sharing.told("port-open", 2)
        server.close()

    run(test())


def _once() -> Any:
    from multidrop.conversation import Ask

    yield Ask(slink3.Frame(2, 0, 0, 0x23))


def test_keys_that_make_no_sense() -> None:
    async def share(**keys: Any) -> None:
        async with shared("slink3", "tcp://127.0.0.1:1", **keys):
            pass

    for keys, message in (
        ({"attempts": "2"}, "its clients repeat"),
        ({"bod": "9600"}, "did you mean 'baud'"),
        ({"broadcast": "x"}, "broadcast"),
    ):
        with pytest.raises(UsageError, match=message):
            run(share(**keys))
