"""The demonstration: what it shows of a device whose state cannot be read."""

from __future__ import annotations

from multidrop.cli.demo import _Watched
from multidrop.cli.live import LiveTable
from multidrop.io.audit import AuditLog
from multidrop.io.connection import Connection, Target
from multidrop.naming import DeviceName
from multidrop.sim.faults import Fault
from multidrop.sim.plant import SHOWN
from multidrop.sim.slink3 import FlexMax
from unit.io.lines import blocking, scripted, simulated


def test_a_fault_whose_cause_cannot_be_read_is_a_fault_all_the_same() -> None:
    drive = FlexMax(0)
    drive.drive.trip(0x2310, 0.0)
    line = blocking(simulated([drive], faults=scripted(None, *[Fault.NO_ANSWER] * 3)))
    target = Target(DeviceName("flexmax", 0, "wire", {}))
    watched = _Watched(
        SHOWN[0], Connection(target, target.device(), line, AuditLog(origin="tests"))
    )
    watched.poll(LiveTable("press", watched.rows))
    setpoint, speed = watched.rows
    assert (setpoint.text, setpoint.bad) == ("0 rpm", True)
    assert setpoint.note == "in fault: no reply in 3 attempts"
    assert (speed.note, speed.bad) == ("fault, code 2310h", True)
