"""Frames in and out of bytes, against pymodbus' RTU framer."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import process_time

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
)

from bench.measure import Result, interleaved, ratio
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Command, Frame

FRAMES = 5000
READ = 512  # bytes
SIZE = 13  # bytes of a frame


def answer(number: int) -> Frame:
    """The OK answer to a typed read of a short int: 13 bytes."""
    value = (number & 0xFFFF).to_bytes(2, "little")
    return Frame(1, number % 16 << 2, 0x01, 0x0000, bytes((3, 0x2C, 0x20)) + value)


def response(number: int) -> ReadHoldingRegistersResponse:
    """The answer to a read of four registers: 13 bytes in RTU."""
    return ReadHoldingRegistersResponse(dev_id=1, registers=[number & 0xFFFF, 2, 3, 4])


def decoding(quick: bool) -> list[Result]:
    framer = FramerRTU(DecodePDU(False))
    stream = b"".join(answer(number).encode() for number in range(FRAMES))
    reads = [stream[at : at + READ] for at in range(0, len(stream), READ)]
    theirs = [framer.buildFrame(response(number)) for number in range(FRAMES)]
    assert len(stream) == FRAMES * SIZE == len(b"".join(theirs))

    def ours() -> int:
        decoder = slink3.decoder()
        return sum(len(decoder.receive_data(data)) for data in reads)

    def decode() -> int:
        return sum(bool(framer.decode(data)[0]) for data in theirs)

    def handle_frame() -> int:
        return sum(framer.handleFrame(data, 1, 0)[1] is not None for data in theirs)

    jobs = {"ours": ours, "decode": decode, "handleFrame": handle_frame}
    found = interleaved(
        20 if quick else 100, {name: _timed(name, job) for name, job in jobs.items()}
    )
    against_decode = ratio(found["decode"], found["ours"])
    kept = _frames_of_reads(framer, b"".join(theirs))
    return [
        Result(
            "stream decoding, 512-byte reads, 13-byte frames",
            "pymodbus RTU framer, `decode`, one frame a call",
            ">= 2.5",
            f"{against_decode:.2f}",
            against_decode >= 2.5,
            [
                f"multidrop {_each(found['ours'])}, `decode` {_each(found['decode'])}, "
                f"`handleFrame` {_each(found['handleFrame'])} a frame",
                f"against `handleFrame`, which makes a PDU with its registers: "
                f"{ratio(found['handleFrame'], found['ours']):.2f}",
                f"from {READ}-byte reads pymodbus' framer gives {kept} of {FRAMES} frames",
            ],
        )
    ]


def _frames_of_reads(framer: FramerRTU, stream: bytes) -> int:
    """How many frames `handleFrame` finds in the reads that multidrop gets; what it leaves is kept."""
    found, buffer = 0, b""
    for at in range(0, len(stream), READ):
        buffer += stream[at : at + READ]
        used, pdu = framer.handleFrame(buffer, 1, 0)
        buffer = buffer[used:]
        found += pdu is not None
    return found


def _timed(name: str, job: Callable[[], int]) -> Callable[[], float]:
    def run() -> float:
        started = process_time()
        count = job()
        seconds = process_time() - started
        assert count == FRAMES, f"{name}: {count} frames of {FRAMES}"
        return seconds

    return run


def encoding(quick: bool) -> list[Result]:
    framer = FramerRTU(DecodePDU(False))
    question = Frame(1, 4, 0, Command.READ_TYPED_PARAMETER, bytes((3, 0x2C, 0x20)))
    ours, theirs = answer(1), response(1)
    asked = ReadHoldingRegistersRequest(dev_id=1, address=44, count=1)
    found = interleaved(
        20 if quick else 100,
        {
            "ours": lambda: _encode_ours(ours),
            "theirs": lambda: _encode_theirs(framer, theirs),
            "our question": lambda: _encode_ours(question),
            "their question": lambda: _encode_theirs(framer, asked),
        },
    )
    answers = ratio(found["theirs"], found["ours"])
    questions = ratio(found["their question"], found["our question"])
    worse = min(answers, questions)
    return [
        Result(
            "frame encoding, frame and PDU ready-made",
            "pymodbus RTU framer, `buildFrame`",
            ">= 2",
            f"{worse:.2f}",
            worse >= 2,
            [
                f"requests of a read (11 bytes, theirs 8): {questions:.2f}, "
                f"multidrop {_each(found['our question'])}, pymodbus {_each(found['their question'])}",
                f"13-byte answers: {answers:.2f}, "
                f"multidrop {_each(found['ours'])}, pymodbus {_each(found['theirs'])}",
            ],
        )
    ]


def _encode_ours(frame: Frame) -> float:
    started = process_time()
    for _ in range(FRAMES):
        frame.encode()
    return process_time() - started


def _encode_theirs(
    framer: FramerRTU, pdu: ReadHoldingRegistersRequest | ReadHoldingRegistersResponse
) -> float:
    started = process_time()
    for _ in range(FRAMES):
        framer.buildFrame(pdu)
    return process_time() - started


def _each(seconds: list[float]) -> str:
    return f"{median(seconds) / FRAMES * 1e6:.2f} µs"
