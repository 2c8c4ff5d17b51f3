"""Simulated slaves on a faulty wire, and what must be true of every read and write on it."""

from __future__ import annotations

import random
from collections.abc import Generator, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from multidrop.catalog import load_profile
from multidrop.conversation import Conversation
from multidrop.device import Write
from multidrop.errors import Error, NoReply, OutcomeUnknown
from multidrop.points import Point, Role, Sample, Value
from multidrop.profile import Profile
from multidrop.protocols.slink3 import Command, Frame, decoder
from multidrop.protocols.slink3.device import Slink3Device, device
from multidrop.sim.faults import Fault, Faults, RandomFaults
from multidrop.sim.line import LineFaults, SimulatedLine
from multidrop.sim.slink3 import FlexMax, SimulatedSlave, ax_v, dgfc386
from multidrop.writing import Outcome, Written

WRITES = (Command.WRITE_TYPED_PARAMETER, Command.WRITE_STANDARD_PARAMETER)


@dataclass(frozen=True)
class Target:
    """A parameter of a slave: what the master calls it, and where the slave keeps it."""

    master: Slink3Device
    point: Point
    slave: SimulatedSlave
    where: tuple[int, int]
    values: tuple[int, ...]  # some that fit
    refused: tuple[int, ...] = ()  # some that the slave refuses

    @property
    def memory(self) -> Value:
        """What the slave holds."""
        parameter = self.slave.parameters.known[self.where]
        return parameter.get(0.0) if parameter.get else parameter.value


def targets() -> tuple[list[SimulatedSlave], list[Target]]:
    """Slaves of every kind, and parameters of every role that can be written."""
    card = dgfc386(0)
    drive, other, ax, direct = FlexMax(0, card), FlexMax(1), ax_v(2), dgfc386(3)
    speeds = (0, 1, -1, 255, 256, 3000, -3000)
    numbers = (0, 1, -1, 255, -256, 257, 0x0101, 32767, -32768)
    flexmax, setting = load_profile("flexmax"), with_role("flexmax", "index_8236", Role.SETTING)
    found = [
        _target(0, flexmax, "8236:int16", drive, (8236, 0), numbers),
        _target(1, setting, "8236:int16", other, (8236, 0), numbers),
        _target(1, flexmax, "speed_setpoint", other, (0x6042, 0), speeds, (3001, -3001)),
        _target(2, load_profile("ax-v"), "1111", ax, (1111, 0), numbers),
        _target(2, with_role("ax-v", "ipa_1009", Role.SETTING), "1009", ax, (1009, 0), numbers),
    ]
    return [drive, other, ax, direct], found


def with_role(profile: str, name: str, role: Role) -> Profile:
    loaded = load_profile(profile)
    described = replace(loaded.points[name], role=role)
    return replace(loaded, points={**loaded.points, name: described})


def _target(
    address: int,
    profile: Profile,
    text: str,
    slave: SimulatedSlave,
    where: tuple[int, int],
    values: tuple[int, ...],
    refused: tuple[int, ...] = (),
) -> Target:
    master = device(address, profile, {})
    assert isinstance(master, Slink3Device)
    return Target(master, master.point(text), slave, where, values, refused)


def faulty_line(
    devices: Iterable[SimulatedSlave], faults: Faults, late: float, echo: bool
) -> SimulatedLine:
    return SimulatedLine(devices, decoder, faults=LineFaults(faults, late, echo))


def every_fault(rate: float, seed: int) -> RandomFaults:
    return RandomFaults(dict.fromkeys(Fault, rate), seed)


@dataclass
class Tally:
    """What came of the transactions."""

    outcomes: dict[str, int] = field(default_factory=dict)

    def count(self, what: str) -> None:
        self.outcomes[what] = self.outcomes.get(what, 0) + 1


class WritesSent:
    """A tap that counts the writes that went out to each address."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, data: bytes, sent: bool, now: float, damaged: bool) -> None:
        self.count += sent and Frame.decode(data).code in WRITES


class Check:
    """What must be true after one transaction, however its wire behaved."""

    def __init__(self, target: Target, write: Write | None, verify: bool) -> None:
        self.target = target
        self.write = write
        self.verify = verify
        self.before = target.memory

    def conversation(self) -> Conversation[Any, Any]:
        if self.write is None:
            return self.target.master.read(self.target.point)
        return self.target.master.write(self.write, verify=self.verify)

    def returned(self, result: Sample | Written, writes_sent: int) -> str:
        if isinstance(result, Sample):
            assert result.value == self.target.memory == self.before
            return "read"
        self._written(result, writes_sent)
        return f"write {result.outcome.value}"

    def raised(self, error: Error, writes_sent: int) -> str:
        """Nothing is sent before the old value is known, and a silent slave changes nothing."""
        assert isinstance(error, NoReply), error
        assert writes_sent == 0
        assert self.target.memory == self.before
        return "write without old value" if self.write else "read without answer"

    def _written(self, record: Written, writes_sent: int) -> None:
        assert self.write is not None
        memory, asked = self.target.memory, self.write.value
        tries = 2 if record.point.role is Role.SETTING else 1
        assert 1 <= writes_sent <= tries, "a write is sent once"
        assert memory in (self.before, asked)
        assert record.old is not None
        assert record.old.value == self.before
        if record.found is not None:
            assert record.found.value == memory
        match record.outcome:
            case Outcome.CONFIRMED:
                assert memory == asked
                assert record.error is None
                assert record.found is not None
            case Outcome.UNVERIFIED:  # the slave said OK
                assert memory == asked
                assert record.error is None or self.verify
            case Outcome.UNKNOWN:
                assert isinstance(record.error, OutcomeUnknown)
            case Outcome.NOT_APPLIED:
                assert asked in self.target.refused
                assert memory == self.before
            case other:
                raise AssertionError(f"{other} of a wire that only loses answers")


def transactions(found: list[Target], dice: random.Random, count: int) -> Generator[Check]:
    """Reads and writes of all targets, in turns that nobody can foresee."""
    for _ in range(count):
        target = dice.choice(found)
        if dice.random() < 0.5:
            yield Check(target, None, True)
        else:
            value = dice.choice(target.values + target.refused)
            write = Write(target.point, value, force=True)
            yield Check(target, write, dice.random() < 0.8)
