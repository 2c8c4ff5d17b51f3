"""Late answers where no number tells them apart: none is taken for that of another question."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import NoReply
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.naming import LineOptions
from multidrop.protocols import datalink, ultra3000
from multidrop.protocols.datalink.device import device
from multidrop.protocols.ultra3000.device import Ultra3000Device
from multidrop.sim.datalink import simulated
from multidrop.sim.faults import Fault, ScriptedFaults
from multidrop.sim.line import LineFaults, Pace, SimulatedLine
from multidrop.sim.ultra3000 import SimulatedUltra3000

DRIVE = load_profile("ultra3000")
CURRENTS = [f"{number:04X}" for number in range(8)]


def drive_line(late: float, *faults: Fault | None) -> tuple[Line, Ultra3000Device]:
    drive = SimulatedUltra3000(0, DRIVE)
    drive.parameters[0x05C].working = list(CURRENTS)
    wire = SimulatedLine(
        [drive],
        ultra3000.decoder,
        pace=Pace(answer_delay=0.005),
        faults=LineFaults(ScriptedFaults(faults), late),
    )
    line = Line(MemoryPort(wire.attach()), ultra3000.LINE, LineOptions(echo="off"))
    return line, Ultra3000Device(0, DRIVE)


def elements(line: Line, master: Ultra3000Device, wanted: Iterable[int]) -> list[str]:
    points = [master.point(f"preset_current.{number}") for number in wanted]
    return [line.run(master.read(point)).raw.decode() for point in points]


@pytest.mark.parametrize("late", [0.199, 0.21, 0.23, 0.3, 0.6, 1.4])
def test_a_late_answer_does_not_shift_the_elements_of_an_array(late: float) -> None:
    line, master = drive_line(late, None, None, Fault.LATE_ANSWER)
    assert elements(line, master, range(8)) == CURRENTS
    assert line.counters.no_reply == 1


def test_nor_do_those_of_an_element_that_was_given_up() -> None:
    line, master = drive_line(0.65, None, *[Fault.LATE_ANSWER] * 3)
    with pytest.raises(NoReply):
        elements(line, master, [0])
    assert elements(line, master, range(1, 8)) == CURRENTS[1:]


def test_a_late_answer_does_not_show_what_was_there_before_a_write() -> None:
    line, master = drive_line(
        0.35, None, None, None, Fault.LATE_ANSWER, None, None, Fault.NO_ANSWER
    )
    assert line.run(master.read(master.point("kp"))).value == 512
    for value in (1.0, 2.0):
        record = line.run(master.write(master.prepare_write("kp", value)))
        assert (record.outcome, record.error) == ("confirmed", None)


def test_a_silent_device_is_asked_the_same_again_at_once() -> None:
    line, master = drive_line(1.0, *[Fault.NO_ANSWER] * 100)
    for _ in range(3):
        with pytest.raises(NoReply):
            elements(line, master, [0])
    assert line.port.now() == pytest.approx(9 * 0.2, abs=0.1)


def test_the_echo_of_a_change_that_was_dropped_is_no_reading() -> None:
    instrument = simulated(load_profile("53mc5000"), 3, None)
    faults = [None, None, *[Fault.LATE_ANSWER] * 3, None, Fault.NO_ANSWER]
    wire = SimulatedLine(
        [instrument], datalink.decoder, faults=LineFaults(ScriptedFaults(faults), 0.35)
    )
    line = Line(MemoryPort(wire.attach()), datalink.LINE, LineOptions(echo="off"))
    host = device(3, load_profile("53mc5000"), {})
    record = line.run(host.write(host.prepare_write("C600", 7.0)))
    assert record.outcome == "not-applied"
    assert line.run(host.read(host.point("C600"))).value == 0.0
