"""The simulated 53MC5000: loops that control, changes at the end of a scan, and its silences."""

from __future__ import annotations

from pathlib import Path

import pytest

from multidrop.errors import NoReply
from multidrop.io.audit import AuditLog
from multidrop.io.connection import Connection, Target
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.datalink import Master
from multidrop.sim.datalink import ENTERED, ENTRY, SimulatedInstrument
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Pace, SimulatedLine
from multidrop.writing import Outcome

LINE = PROTOCOLS["datalink"].line


def simulated(profile: str, address: int, behind: str | None) -> SimulatedInstrument:
    found = simulated_device(profile, address, behind)
    assert isinstance(found, SimulatedInstrument)
    return found


def wire(instrument: SimulatedInstrument) -> MemoryPort:
    pace = Pace(LINE.character, answer_delay=0.005)
    return MemoryPort(SimulatedLine([instrument], LINE.decoder, silence=0.1, pace=pace).attach())


def controller(
    tmp_path: Path, instrument: SimulatedInstrument, profile: str = "53mc5000"
) -> Connection:
    target = Target.of(f"{profile}:3@memory")
    line = Line(wire(instrument), LINE)
    audit = AuditLog(tmp_path / "audit.jsonl", origin="test")
    return Connection(target, target.device(), line, audit)


def let_pass(connection: Connection, seconds: float) -> None:
    assert connection.line.port.read(seconds) == b""


def test_a_loop_brings_its_process_to_the_setpoint(tmp_path: Path) -> None:
    connection = controller(tmp_path, simulated("53mc5000", 3, None))
    connection.write("C101", 70.0)
    let_pass(connection, 59.0)
    assert connection.read("C100").value == pytest.approx(70.0, abs=0.5)
    assert connection.read("C102").value == pytest.approx(70.0 / 0.9, abs=1.0)


def test_all_four_loops_run_each_by_itself(tmp_path: Path) -> None:
    connection = controller(tmp_path, simulated("53mc5000", 3, None))
    for loop, setpoint in enumerate((20.0, 40.0, 60.0, 80.0)):
        connection.write(f"C{101 + 36 * loop}", setpoint)
    let_pass(connection, 59.0)
    for loop, setpoint in enumerate((20.0, 40.0, 60.0, 80.0)):
        assert connection.read(f"C{100 + 36 * loop}").value == pytest.approx(setpoint, abs=0.5)


def test_in_manual_the_output_stays_where_it_was_put(tmp_path: Path) -> None:
    connection = controller(tmp_path, simulated("53mc5000", 3, None))
    connection.write("L112", 0)
    connection.write("C102", 10.0)
    let_pass(connection, 30.0)
    assert connection.read("L107").value is False
    assert connection.read("C102").value == 10.0
    assert connection.read("C100").value == pytest.approx(9.0, abs=0.2)


def test_not_reversed_the_output_runs_away(tmp_path: Path) -> None:
    connection = controller(tmp_path, simulated("53mc5000", 3, None))
    connection.write("L106", 0)
    connection.write("C101", 80.0)
    let_pass(connection, 59.0)
    assert connection.read("C102").value == 0.0


def test_an_alarm_trips_at_its_limit_and_goes_behind_the_dead_band(tmp_path: Path) -> None:
    connection = controller(tmp_path, simulated("53mc5000", 3, None))
    connection.write("C103", 60.0)
    connection.write("C101", 65.0)
    let_pass(connection, 59.0)
    assert connection.read("L110").value is True
    connection.write("C101", 59.0)  # below the limit, within the dead band of 2
    let_pass(connection, 59.0)
    assert connection.read("L110").value is True
    connection.write("C101", 50.0)
    let_pass(connection, 59.0)
    assert connection.read("L110").value is False


def test_the_remote_setpoint_has_ratio_and_bias(tmp_path: Path) -> None:
    connection = controller(tmp_path, simulated("53mc5000", 3, None))
    for point, value in (("C120", 20.0), ("C113", 2.0), ("C112", 5.0)):
        connection.write(point, value)
    connection.write("L113", 1)
    let_pass(connection, 1.0)
    assert connection.read("L108").value is True
    assert connection.read("C101").value == 45.0


def test_a_change_acts_at_the_end_of_the_scan() -> None:
    instrument = simulated("53mc5000", 3, None)
    line = Line(wire(instrument), LINE)
    line.port.read(0.01 - line.port.now())
    memory = instrument.inside.memory.raw
    line.run(Master(3).change(0x1000, b"\x08\x0c"))
    instrument.advance(line.port.now())
    assert memory[0x1000:0x1002] == b"\0\0"
    instrument.advance(0.1)
    assert memory[0x1000:0x1002] == b"\x08\x0c"


def test_a_write_is_confirmed_once_the_scan_has_applied_it(tmp_path: Path) -> None:
    connection = controller(tmp_path, simulated("53mc5000", 3, None))
    assert connection.write("C106", 150.5).outcome is Outcome.CONFIRMED


def test_another_address_is_not_answered() -> None:
    line = Line(wire(simulated("53mc5000", 3, None)), LINE)
    with pytest.raises(NoReply):
        line.run(Master(4).interrogate(0x1000, 1))


def test_a_53sl6000_has_map_b(tmp_path: Path) -> None:
    connection = controller(tmp_path, simulated("53sl6000", 3, None), "53sl6000")
    assert connection.read("A0").value == "SIMULATED"


class TestConfigurationPort:
    def test_before_the_entry_sequence_nothing_is_answered(self) -> None:
        line = Line(wire(simulated("53mc5000", 3, "port")), LINE)
        with pytest.raises(NoReply):
            line.run(Master(3).interrogate(0x8002, 1))

    def test_behind_it_any_address_is_answered_for_thirty_seconds(self) -> None:
        port = wire(simulated("53mc5000", 3, "port"))
        line = Line(port, LINE)
        port.write(ENTRY)
        assert port.read(1.0) == ENTERED[:1]
        assert b"".join(iter(lambda: port.read(0.1), b"")) == ENTERED[1:]
        assert line.run(Master(7).interrogate(0x8002, 1)) == b"\x06"
        assert line.run(Master(3).interrogate(0x8002, 1)) == b"\x06"
        port.read(30.1)
        with pytest.raises(NoReply):
            line.run(Master(3).interrogate(0x8002, 1))

    def test_the_action_opens_it(self, tmp_path: Path) -> None:
        connection = controller(tmp_path, simulated("53mc5000", 3, "port"))
        with pytest.raises(NoReply):
            connection.read("C101")
        assert connection.act("open_configuration_port").fields == {
            "action": "open_configuration_port"
        }
        assert connection.read("C101").value == 50.0

    def test_the_action_fails_on_a_port_that_does_not_open(self, tmp_path: Path) -> None:
        connection = controller(tmp_path, simulated("53mc5000", 3, "port"))
        connection.line.port = MemoryPort(SimulatedLine([], LINE.decoder).attach())
        with pytest.raises(NoReply, match="the configuration port did not open: no reply"):
            connection.act("open_configuration_port")
