"""Datalink: decoding against pymodbus' RTU framer, paced reads, points read together."""

from __future__ import annotations

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU

from bench.codec import FRAMES, READ, SIZE, _each, _timed, response
from bench.measure import Result, interleaved, ratio
from bench.paced_read import PacedRead, paced_read
from multidrop.catalog import load_profile
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.protocols import datalink
from multidrop.protocols.datalink import Command, Frame
from multidrop.protocols.datalink.device import device
from multidrop.sim.controller import Controller
from multidrop.sim.datalink import SimulatedInstrument
from multidrop.sim.line import SimulatedLine

ONE_REAL = PacedRead("53mc5000", "C103", request=6, answer=9)


def rows(quick: bool) -> list[Result]:
    return [*decoding(quick), hundred_points(), *paced_read(ONE_REAL, quick)]


def responses(data: list[bytes]) -> list[bytes]:
    """As many responses as other frames are decoded, with these data in turn."""
    raws = [
        Frame(Command.RESPONSE, 3, 0x0600, len(found), found).encode()
        for found in (data[number % len(data)] for number in range(FRAMES))
    ]
    assert {len(raw) for raw in raws} == {SIZE}
    return raws


def decoding(quick: bool) -> list[Result]:
    """Data without 7Eh, and data with one in every message: both are 13 bytes on the wire."""
    framer = FramerRTU(DecodePDU(False))
    theirs = [framer.buildFrame(response(number)) for number in range(FRAMES)]
    values = [bytes((number, 0x55, 0x45, 0x70, 0x0B, 0x64, 0)) for number in range(97)]
    plain = _reads(responses(values))
    stuffed = _reads(responses([value[:2] + b"\x7e" + value[3:6] for value in values]))
    jobs = {
        "plain": lambda: _decoded(plain),
        "stuffed": lambda: _decoded(stuffed),
        "decode": lambda: sum(bool(framer.decode(data)[0]) for data in theirs),
    }
    found = interleaved(
        20 if quick else 100, {name: _timed(name, job) for name, job in jobs.items()}
    )
    return [
        Result(
            f"Datalink stream decoding, {READ}-byte reads, 13-byte messages, {what}",
            "pymodbus RTU framer, `decode`, one frame a call",
            ">= 2",
            f"{ratio(found['decode'], found[name]):.2f}",
            ratio(found["decode"], found[name]) >= 2,
            [f"multidrop {_each(found[name])}, `decode` {_each(found['decode'])} a frame"],
        )
        for name, what in (("plain", "no 7Eh in them"), ("stuffed", "one stuffed 7Eh in each"))
    ]


def _reads(raws: list[bytes]) -> list[bytes]:
    stream = b"".join(raws)
    return [stream[at : at + READ] for at in range(0, len(stream), READ)]


def _decoded(reads: list[bytes]) -> int:
    decoder = datalink.decoder()
    return sum(len(decoder.receive_data(data)) for data in reads)


def hundred_points() -> Result:
    """C300 to C399 of a simulated 53MC5000: how many messages ask for them."""
    instrument = SimulatedLine([SimulatedInstrument(3, Controller(3))], datalink.decoder)
    line = Line(MemoryPort(instrument.attach()), datalink.LINE)
    host = device(3, load_profile("53mc5000"), {})
    line.run(host.read(host.point("C0")))  # with the look at the map
    before = line.counters.requests
    points = host.points("C300..C399")
    read = sum(len(line.run(host.read_group(group))) for group in host.plan(points))
    assert read == len(points) == 100
    messages = line.counters.requests - before
    return Result(
        "messages that read 100 neighbouring C points of a 53MC5000",
        "one message a point",
        "10",
        str(messages),
        messages == 10,
        ["and one, once for each instrument, that looks at its memory map"],
    )
