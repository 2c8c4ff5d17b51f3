"""Datalink on a wire where everything goes wrong: memory is as the confirmed writes say, no wrong value is read.

`MULTIDROP_SOAK=1` runs 10,000 transactions of each kind, else some dozens.
"""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.conversation import Conversation, Wait
from multidrop.device import Write
from multidrop.errors import NoReply, NotApplied, OutcomeUnknown, ProtocolError
from multidrop.events import Damaged, FrameReceived
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.naming import LineOptions
from multidrop.points import Value
from multidrop.protocols import datalink
from multidrop.protocols.datalink import MAP_A, Command, Frame
from multidrop.protocols.datalink.device import DatalinkDevice, device
from multidrop.protocols.datalink.memory import MAP_IDENTIFIER_AT
from multidrop.protocols.datalink.messages import applied
from multidrop.protocols.datalink.points import DataPoint
from multidrop.sim.controller import SCAN, Memory
from multidrop.sim.datalink import SimulatedInstrument, Still
from multidrop.sim.line import LineFaults, Pace, SimulatedLine
from multidrop.writing import Outcome, Written
from soak.faulty import Tally, every_fault

COUNT = 10_000 if "MULTIDROP_SOAK" in os.environ else 150
PATIENCE = 60.0
"""s of the wire's own time that no transaction may take: 24 messages, each perhaps behind a rest."""

REALS = (0.0, 1.0, -1.0, 100.0, 126.0, -0.1, 1e9, 2.0**-128)
TEXTS = ("", "~", "~\0~", "TAG 1", "0123456789")
POINTS: dict[str, tuple[Value, ...]] = {
    "C103": REALS,
    "C104": REALS,
    "H7": REALS,
    "B30": (0, 1, 0x7E, 0xFF),
    "L300": (True, False),
    "L301": (True, False),
    "A50": TEXTS,
    "F101": TEXTS[:4],  # laid over A50
    "mem/0x7E7E/2": (b"\x7e\x00", b"\x00\x7e", b"\x7e\x7e"),
    "mem/0xFFE0/32": (b"\x7e" * 32, bytes(32), bytes(range(32))),
}
TOGETHER = ("C103", "C104", "L300", "B30")


class Quiet(Still):
    """Memory with map A that only changes when somebody changes it."""

    def __init__(self) -> None:
        self.memory = Memory(MAP_A)
        self.memory.raw[MAP_IDENTIFIER_AT] = 6


class Noisy(SimulatedInstrument):
    """It mishears some changes, with a right LRC, and the line adds the beginning of a frame to some answers."""

    def __init__(self, address: int, seed: int) -> None:
        super().__init__(address, Quiet())
        self._dice = random.Random(seed)

    def receive(self, events: list[FrameReceived[Frame] | Damaged], now: float) -> list[bytes]:
        return [
            answer + (b"\x7e\x23\x20" if self._dice.random() < 0.05 else b"")
            for answer in super().receive([self._misheard(event) for event in events], now)
        ]

    def _misheard(self, event: FrameReceived[Frame] | Damaged) -> FrameReceived[Frame] | Damaged:
        if isinstance(event, Damaged) or event.frame.command is not Command.CHANGE:
            return event
        if self._dice.random() >= 0.05:
            return event
        data = bytes([event.frame.data[0] ^ 0x41]) + event.frame.data[1:]
        return FrameReceived(event.frame._replace(data=data), event.raw)

    def disguise(self, answer: bytes, fault: Any) -> bytes:
        (event, *_) = datalink.decoder().receive_data(answer)
        assert isinstance(event, FrameReceived)
        return super().disguise(event.raw, fault)


class Acknowledges:
    """A tap: how long after its echo each Acknowledge went out."""

    def __init__(self) -> None:
        self.after: list[float] = []
        self._decoder = datalink.decoder()
        self._heard = 0.0

    def __call__(self, data: bytes, sent: bool, now: float, damaged: bool) -> None:
        if not sent:
            events = self._decoder.receive_data(data)
            if any(isinstance(event, FrameReceived) for event in events):
                self._heard = now
            return
        self._decoder.silence()
        for event in datalink.decoder().receive_data(data):
            assert isinstance(event, FrameReceived)
            if event.frame.command is Command.ACKNOWLEDGE:
                self.after.append(now - self._heard)


@dataclass
class Side:
    """An instrument, the host's view of it, and what its memory must be."""

    instrument: SimulatedInstrument
    host: DatalinkDevice
    expected: bytearray

    def bytes_of(self, point: DataPoint) -> bytes:
        return point.sample(bytes(self.memory[point.memory_address :][: point.count])).raw

    @property
    def memory(self) -> bytearray:
        return self.instrument.inside.memory.raw


class Plant:
    """Two instruments next to each other on one faulty line, so that each is the other's neighbour."""

    def __init__(self, options: LineOptions, late: float, pace: Pace, seed: int) -> None:
        self.dice = random.Random(seed)
        instruments = [Noisy(address, seed + address) for address in (3, 4)]
        faults = LineFaults(every_fault(0.05, seed), late, options.echo != "off")
        wire = SimulatedLine(instruments, datalink.decoder, pace=pace, faults=faults)
        self.port = MemoryPort(wire.attach())
        self.line = Line(self.port, datalink.LINE, options)
        self.acknowledges = Acknowledges()
        self.line.taps.append(self.acknowledges)
        profile = load_profile("53mc5000")
        self.sides = []
        for instrument in instruments:
            host = device(instrument.address, profile, {})
            self.sides.append(Side(instrument, host, bytearray(instrument.inside.memory.raw)))

    def transactions(self, count: int) -> Iterator[str]:
        for _ in range(count):
            side = self.dice.choice(self.sides)
            started = self.port.now()
            happened = self._read(side) if self.dice.random() < 0.5 else self._write(side)
            assert self.port.now() - started < PATIENCE
            self._rest(side)
            assert side.memory == side.expected
            yield happened

    def _rest(self, side: Side) -> None:
        """Until the scan is over in which the last Acknowledge can have come, and with it its change."""

        def rest() -> Conversation[Any, None]:
            yield Wait(2 * SCAN)

        self.line.run(rest())
        side.instrument.advance(self.port.now())

    def _read(self, side: Side) -> str:
        texts = TOGETHER if self.dice.random() < 0.3 else (self.dice.choice(list(POINTS)),)
        for group in side.host.plan(side.host.point(text) for text in texts):
            try:
                samples = self.line.run(side.host.read_group(group))
            except NoReply:
                return "read without answer"
            for point, sample in zip(group, samples, strict=True):
                assert sample.raw == side.bytes_of(point)
        return "read"

    def _write(self, side: Side) -> str:
        text = self.dice.choice(list(POINTS))
        write = side.host.prepare_write(text, self.dice.choice(POINTS[text]), force=True)
        verify = self.dice.random() < 0.8
        point = side.host.point(text)
        before = side.bytes_of(point)
        acknowledged = len(self.acknowledges.after)
        try:
            record = self.line.run(side.host.write(write, verify=verify))
        except NoReply:
            assert len(self.acknowledges.after) == acknowledged
            return "write without old value"
        assert record.old is not None
        assert record.old.raw == before
        self._judge(side, write, record, verify, len(self.acknowledges.after) - acknowledged)
        if record.found is not None:
            assert record.found.raw in (before, side.bytes_of(point))
        return f"write {record.outcome.value}"

    def _judge(
        self, side: Side, write: Write, record: Written, verify: bool, acknowledges: int
    ) -> None:
        """The record says what is true once the scan is over."""
        assert isinstance(write.point, DataPoint)
        change = side.host._change(write)
        where = slice(change.memory_address, change.memory_address + write.point.count)
        before = bytes(side.expected[where])
        wanted = applied(change, before)
        assert acknowledges <= 1
        self._rest(side)
        memory = bytes(side.memory[where])
        match record.outcome:
            case Outcome.CONFIRMED:
                assert acknowledges == 1
                assert record.error is None
                side.expected[where] = wanted
            case Outcome.NOT_APPLIED:
                assert isinstance(record.error, NoReply | NotApplied | ProtocolError)
            case Outcome.UNVERIFIED:
                assert not verify
                assert acknowledges == 1
                side.expected[where] = memory
            case Outcome.UNKNOWN:
                assert isinstance(record.error, OutcomeUnknown)
                assert acknowledges == 1
                side.expected[where] = memory
            case other:
                raise AssertionError(other)
        assert memory in (before, wanted)


@pytest.mark.parametrize("pace", [Pace(), Pace(datalink.LINE.character)], ids=["at once", "paced"])
@pytest.mark.parametrize("late", [0.05, 0.15, 1.0])
@pytest.mark.parametrize("echo", ["on", "off", "auto"])
def test_memory_is_as_the_confirmed_writes_say(echo: str, late: float, pace: Pace) -> None:
    plant = Plant(LineOptions(echo=echo), late, pace, seed=10 * len(echo) + int(20 * late))
    tally = Tally()
    for happened in plant.transactions(COUNT):
        tally.count(happened)
    assert max(plant.acknowledges.after) <= 0.080
    assert tally.outcomes["read"] > 0.3 * COUNT
    assert tally.outcomes["write confirmed"] > 0.15 * COUNT
    if COUNT >= 10_000:
        assert tally.outcomes["write not-applied"] > 10
        assert tally.outcomes["write unknown"] > 1
        assert tally.outcomes["read without answer"] > 10
