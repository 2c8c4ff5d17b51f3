"""Ultra3000 on a wire where everything goes wrong: a drive holds what the confirmed writes say,
and no wrong value is read.

`MULTIDROP_SOAK=1` runs 10,000 transactions of each kind, else some dozens.
"""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from multidrop.catalog import load_profile
from multidrop.device import Copy, Write
from multidrop.errors import DeviceError, NoReply, OutcomeUnknown
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.naming import LineOptions
from multidrop.points import Role, Value
from multidrop.protocols import ultra3000
from multidrop.protocols.ultra3000 import Frame, View
from multidrop.protocols.ultra3000.device import Ultra3000Device
from multidrop.protocols.ultra3000.frame import READS
from multidrop.protocols.ultra3000.points import ParameterPoint
from multidrop.sim.line import LineFaults, SimulatedLine
from multidrop.sim.ultra3000 import SimulatedUltra3000
from multidrop.writing import Outcome, Written
from soak.faulty import Tally, every_fault

COUNT = 10_000 if "MULTIDROP_SOAK" in os.environ else 120
PATIENCE = 60.0
"""s of the wire's own time that no transaction may take: an array of eight is read three times."""

PROFILE = load_profile("ultra3000")
POINTS: dict[str, tuple[Value, ...]] = {
    "kp": (0, 0.5, 4, 31.9921875),
    "kp@nv": (0, 1.5, 4),
    "position_error_limit": (0, 8000, 2147483647),
    "position_error_limit@nv": (0, 255),
    "setpoint_velocity": (0, 1, -1, 3000),
    "preset_current.0": (0, 1.5, -255.9921875),
    "preset_current.7": (0, 2),
    "preset_current.7@nv": (0, -3),
    "drive_name": ("", "AXIS 1", "0123456789" * 6),
}
REFUSED: dict[str, Value] = {"kp": 32, "kp@nv": 300, "preset_current.0": -255.99999}
COPIED = ("kp", "position_error_limit", "preset_current")

Held = dict[tuple[int, View], tuple[str, ...]]
"""The digits of every element of every parameter, working and saved."""


@dataclass
class Side:
    """A drive, the master's view of it, and what it must hold."""

    drive: SimulatedUltra3000
    master: Ultra3000Device
    expected: Held = field(default_factory=dict)

    @property
    def holds(self) -> Held:
        held: Held = {}
        for number, known in self.drive.parameters.items():
            held[number, View.WORKING] = tuple(known.working)
            held[number, View.NV] = tuple(known.saved)
        return held


def digits(held: Held, point: ParameterPoint) -> bytes:
    return held[point.parameter, point.view][point.element or 0].encode()


class Sent:
    """A tap that counts what was sent and is no read."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, data: bytes, sent: bool, now: float, damaged: bool) -> None:
        self.count += sent and Frame.decode(data).function not in READS


class Plant:
    """Two drives next to each other on one faulty line, so that each is the other's neighbour."""

    def __init__(self, options: LineOptions, late: float, seed: int) -> None:
        self.dice = random.Random(seed)
        drives = [SimulatedUltra3000(address, PROFILE) for address in (0, 1)]
        faults = LineFaults(every_fault(0.05, seed), late, options.echo != "off")
        wire = SimulatedLine(drives, ultra3000.decoder, faults=faults)
        self.port = MemoryPort(wire.attach())
        self.line = Line(self.port, ultra3000.LINE, options)
        self.sent = Sent()
        self.line.taps.append(self.sent)
        self.sides = [Side(drive, Ultra3000Device(drive.address, PROFILE)) for drive in drives]
        for side in self.sides:
            side.expected = side.holds

    def transactions(self, count: int) -> Iterator[str]:
        for _ in range(count):
            side = self.dice.choice(self.sides)
            started, self.sent.count = self.port.now(), 0
            what = self.dice.choices((self._read, self._write, self._copy), (9, 8, 2))[0]
            happened = what(side)
            assert self.port.now() - started < PATIENCE
            assert side.holds == side.expected
            yield happened

    def _read(self, side: Side) -> str:
        point = side.master.point(self.dice.choice(list(POINTS)))
        try:
            sample = self.line.run(side.master.read(point))
        except NoReply:
            return "read without answer"
        assert sample.raw == digits(side.holds, point)
        assert self.sent.count == 0
        return "read"

    def _write(self, side: Side) -> str:
        text = self.dice.choice(list(POINTS))
        refused = text in REFUSED and self.dice.random() < 0.2
        value = REFUSED[text] if refused else self.dice.choice(POINTS[text])
        write = side.master.prepare_write(text, value, force=True)
        verify, before = self.dice.random() < 0.8, side.holds
        try:
            record = self.line.run(side.master.write(write, verify=verify))
        except NoReply:
            assert self.sent.count == 0
            return "write without old value"
        tries = 2 if write.point.role is Role.SETTING and not text.endswith("@nv") else 1
        assert 1 <= self.sent.count <= tries, "a write is sent once"
        self._judge(side, [record], [self._wanted(side, write, before)], before, refused)
        return f"write {record.outcome.value}"

    def _copy(self, side: Side) -> str:
        save, before = self.dice.random() < 0.5, side.holds
        copy = side.master.prepare_copy(self.dice.choice(COPIED), save=save)
        try:
            records = self.line.run(side.master.copy(copy))
        except NoReply:
            assert self.sent.count == 0
            return "copy without old value"
        assert self.sent.count == 1
        wanted = [self._copied(before, copy)] * len(records)
        self._judge(side, records, wanted, before, False)
        return f"copy {records[0].outcome.value}"

    def _wanted(self, side: Side, write: Write, before: Held) -> Held:
        """What the drive holds once it has carried the write out."""
        point = write.point
        assert isinstance(point, ParameterPoint)
        told = side.master.digits(write, None)
        held = dict(before)
        for view in (View.WORKING, View.NV) if point.view is View.NV else (View.WORKING,):
            elements = list(held[point.parameter, view])
            elements[point.element or 0] = told
            held[point.parameter, view] = tuple(elements)
        return held

    def _copied(self, before: Held, copy: Copy) -> Held:
        assert isinstance(copy.point, ParameterPoint)
        number = copy.point.parameter
        to, source = (View.NV, View.WORKING) if copy.save else (View.WORKING, View.NV)
        return {**before, (number, to): before[number, source]}

    def _judge(
        self, side: Side, records: list[Written], wanted: list[Held], before: Held, refused: bool
    ) -> None:
        """Each record says what is true."""
        after = side.holds
        assert after in (before, wanted[0])
        for record, held in zip(records, wanted, strict=True):
            point = record.point
            assert isinstance(point, ParameterPoint)
            assert record.old is not None
            assert record.old.raw == digits(before, point)
            assert record.found is None or record.found.raw == digits(after, point)
            match record.outcome:
                case Outcome.CONFIRMED:
                    assert record.error is None
                    assert digits(after, point) == digits(held, point)
                case Outcome.NOT_APPLIED:
                    assert isinstance(record.error, DeviceError)
                    assert refused
                    assert after == before
                case Outcome.UNKNOWN:
                    assert isinstance(record.error, OutcomeUnknown)
                case Outcome.UNVERIFIED:
                    assert not refused
                case other:
                    raise AssertionError(other)
        certain = {record.outcome for record in records} <= {Outcome.CONFIRMED}
        side.expected = wanted[0] if certain else after


@pytest.mark.parametrize("late", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("echo", ["on", "off", "auto"])
def test_the_drive_holds_what_the_confirmed_writes_say(echo: str, late: float) -> None:
    plant = Plant(LineOptions(echo=echo), late, seed=10 * len(echo) + int(20 * late))
    tally = Tally()
    for happened in plant.transactions(COUNT):
        tally.count(happened)
    assert tally.outcomes["read"] > 0.3 * COUNT
    assert tally.outcomes["write confirmed"] > 0.15 * COUNT
    if COUNT >= 10_000:
        assert tally.outcomes["copy confirmed"] > 0.02 * COUNT
        assert tally.outcomes["write not-applied"] > 10
        assert tally.outcomes["write unknown"] > 10
        assert tally.outcomes["read without answer"] > 10
