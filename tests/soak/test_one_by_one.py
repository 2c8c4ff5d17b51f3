"""Every fault by itself, at every place of a read and a write: what comes of it."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.conversation import Conversation, Wait
from multidrop.errors import NoReply, OutcomeUnknown
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.naming import LineOptions
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Master
from multidrop.session import Counters
from multidrop.sim.faults import Fault, ScriptedFaults
from multidrop.writing import Outcome, Written
from soak.faulty import Target, WritesSent, faulty_line, targets

LOST = [fault for fault in Fault if fault not in (Fault.NOISE, Fault.TWICE)]
LATE = 1.6  # later than a master waits on a serial port


class Bench:
    """One slave on a line whose answers have these faults, one after the other."""

    def __init__(self, *faults: Fault | None, echo: bool = False, target: int = 0) -> None:
        devices, found = targets()
        wire = faulty_line(devices, ScriptedFaults(faults), LATE, echo)
        self.target: Target = found[target]
        self.port = MemoryPort(wire.attach())
        self.line = Line(self.port, slink3.LINE, LineOptions())
        self.sent = WritesSent()
        self.line.taps.append(self.sent)

    @property
    def counters(self) -> Counters:
        return self.line.counters

    def read(self) -> Any:
        return self.line.run(self.target.master.read(self.target.point)).value

    def rest(self) -> None:
        """Keep the line's turn until whatever is late has come."""

        def rest() -> Conversation[Any, None]:
            yield Wait(3.0)

        self.line.run(rest())

    def write(self, value: int) -> Written:
        write = self.target.master.prepare_write(self.target.point.text, value)
        return self.line.run(self.target.master.write(write))


def test_without_faults() -> None:
    bench = Bench()
    assert bench.read() == 0
    assert bench.write(1234).outcome is Outcome.CONFIRMED
    assert bench.target.memory == 1234
    assert (bench.counters.requests, bench.counters.answers) == (4, 4)


@pytest.mark.parametrize("fault", LOST)
def test_a_read_whose_first_answer_is_lost_is_asked_again(fault: Fault) -> None:
    bench = Bench(fault)
    assert bench.read() == 0
    assert bench.counters.requests == 2
    assert bench.counters.no_reply == 1
    assert bench.port.now() == pytest.approx(1.52 + 11 * slink3.LINE.character, abs=0.05)


def test_noise_before_the_answer_costs_nothing() -> None:
    bench = Bench(Fault.NOISE)
    assert bench.read() == 0
    assert (bench.counters.requests, bench.counters.damaged) == (1, 1)
    assert bench.port.now() == 0.0


@pytest.mark.parametrize(
    ("fault", "damaged", "foreign"),
    [
        (Fault.WRONG_CHECKSUM, 1, 0),
        (Fault.CUT_SHORT, 1, 0),
        (Fault.OTHER_SLAVE, 0, 1),
        (Fault.WRONG_SEQUENCE, 0, 1),
        (Fault.LATE_ANSWER, 0, 1),
        (Fault.NO_ANSWER, 0, 0),
    ],
)
def test_what_came_instead_is_counted(fault: Fault, damaged: int, foreign: int) -> None:
    bench = Bench(fault)
    bench.read()
    bench.rest()
    assert (bench.counters.damaged, bench.counters.foreign) == (damaged, foreign)


@pytest.mark.parametrize("fault", LOST)
def test_a_read_that_is_never_answered(fault: Fault) -> None:
    bench = Bench(*[fault] * 3)
    with pytest.raises(NoReply) as caught:
        bench.read()
    assert caught.value.attempts == 3
    assert bool(caught.value.damaged) is (
        fault in (Fault.WRONG_CHECKSUM, Fault.CUT_SHORT, Fault.GAP)
    )
    heard = fault in (Fault.OTHER_SLAVE, Fault.WRONG_SEQUENCE, Fault.LATE_ANSWER)
    assert bool(caught.value.heard) is heard
    assert bench.read() == 0  # the line itself is well


@pytest.mark.parametrize("fault", LOST)
def test_nothing_is_written_where_the_old_value_cannot_be_read(fault: Fault) -> None:
    bench = Bench(*[fault] * 3)
    with pytest.raises(NoReply):
        bench.write(1234)
    assert bench.sent.count == 0
    assert bench.target.memory == 0


@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize("fault", LOST)
def test_a_write_whose_answer_is_lost_is_confirmed_by_the_read_back(
    fault: Fault, echo: bool
) -> None:
    bench = Bench(None, fault, echo=echo)
    record = bench.write(1234)
    assert (record.outcome, record.error) == (Outcome.CONFIRMED, None)
    assert bench.target.memory == 1234
    assert bench.sent.count == 1


@pytest.mark.parametrize("target", [0, 1])  # a point of unknown role, and a setting
@pytest.mark.parametrize("fault", LOST)
def test_a_write_of_which_nothing_more_is_heard_is_unknown(fault: Fault, target: int) -> None:
    bench = Bench(None, *[fault] * 4, target=target)
    record = bench.write(1234)
    assert record.outcome is Outcome.UNKNOWN
    assert isinstance(record.error, OutcomeUnknown)
    assert bench.sent.count == 1


@pytest.mark.parametrize("fault", LOST)
def test_a_write_that_was_answered_and_cannot_be_read_back(fault: Fault) -> None:
    bench = Bench(None, None, *[fault] * 3)
    record = bench.write(1234)
    assert record.outcome is Outcome.UNVERIFIED
    assert isinstance(record.error, NoReply)
    assert bench.target.memory == 1234


@pytest.mark.parametrize("fault", Fault)
def test_a_late_ok_does_not_confirm_the_next_write(fault: Fault) -> None:
    """The answer to a write carries no INDEX: only its number says which write it answers."""
    bench = Bench(Fault.LATE_ANSWER, fault)
    master = Master(0, slink3.FLEXMAX)
    with pytest.raises(NoReply):
        bench.line.run(master.write_typed(8236, slink3.Format.SHORT_INT, 1))
    if fault not in LOST:
        bench.line.run(master.write_typed(8236, slink3.Format.SHORT_INT, 2))
    else:
        with pytest.raises(NoReply):
            bench.line.run(master.write_typed(8236, slink3.Format.SHORT_INT, 2))
    bench.rest()
    assert bench.counters.foreign >= 1
