"""Ultra3000: decoding against pymodbus' ASCII framer, paced reads."""

from __future__ import annotations

from pymodbus.framer import FramerAscii
from pymodbus.pdu import DecodePDU
from pymodbus.pdu.register_message import ReadHoldingRegistersResponse

from bench.codec import FRAMES, READ, _each, _timed
from bench.measure import Result, interleaved, ratio
from bench.paced_read import PacedRead, paced_read
from multidrop.protocols import ultra3000
from multidrop.protocols.ultra3000 import Frame

SIZE = 19  # characters: with two registers in ASCII, with nine digits here
VELOCITY = PacedRead("ultra3000", "setpoint_velocity", request=10, answer=18)


def rows(quick: bool) -> list[Result]:
    return [*decoding(quick), *paced_read(VELOCITY, quick)]


def decoding(quick: bool) -> list[Result]:
    framer = FramerAscii(DecodePDU(False))
    theirs = [
        framer.buildFrame(ReadHoldingRegistersResponse(dev_id=1, registers=[number & 0xFFFF, 2]))
        for number in range(FRAMES)
    ]
    raws = [Frame(0, 0x06D, 0, f"{number:09X}").encode() for number in range(FRAMES)]
    assert {len(raw) for raw in raws} == {len(raw) for raw in theirs} == {SIZE}
    stream, their_stream = b"".join(raws), b"".join(theirs)
    reads = [stream[at : at + READ] for at in range(0, len(stream), READ)]

    def ours() -> int:
        decoder = ultra3000.decoder()
        return sum(len(decoder.receive_data(data)) for data in reads)

    def from_reads() -> int:
        """What `decode` leaves of a read is kept for the next one."""
        found, kept = 0, b""
        for at in range(0, len(their_stream), READ):
            kept += their_stream[at : at + READ]
            used, device, _, _ = framer.decode(kept)
            while used and device:
                found, kept = found + 1, kept[used:]
                used, device, _, _ = framer.decode(kept)
        return found

    jobs = {
        "ours": ours,
        "decode": lambda: sum(bool(framer.decode(data)[0]) for data in theirs),
        "reads": from_reads,
        "handleFrame": lambda: sum(
            framer.handleFrame(data, 1, 0)[1] is not None for data in theirs
        ),
    }
    found = interleaved(
        20 if quick else 100, {name: _timed(name, job) for name, job in jobs.items()}
    )
    against_decode = ratio(found["decode"], found["ours"])
    return [
        Result(
            f"Ultra3000 stream decoding, {READ}-byte reads, {SIZE}-character frames",
            "pymodbus ASCII framer, `decode`, one frame a call",
            ">= 2.5",
            f"{against_decode:.2f}",
            against_decode >= 2.5,
            [
                f"multidrop {_each(found['ours'])}, `decode` {_each(found['decode'])}, "
                f"`handleFrame` {_each(found['handleFrame'])} a frame",
                f"against `decode` on the same reads: {ratio(found['reads'], found['ours']):.2f}; "
                f"against `handleFrame`: {ratio(found['handleFrame'], found['ours']):.2f}",
            ],
        )
    ]
