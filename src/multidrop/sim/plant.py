"""The demonstration plant: a press line, a vessel and a servo, each on a line of its own, all moving."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass

from multidrop.catalog import load_profile
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.slink3.status import ENABLE_OPERATION, FAULT_RESET, SHUTDOWN, SWITCH_ON
from multidrop.sim.controller import Controller
from multidrop.sim.datalink import SimulatedInstrument
from multidrop.sim.line import Pace, SimulatedDevice, SimulatedLine
from multidrop.sim.slink3 import FlexMax, ax_v, dgfc386
from multidrop.sim.ultra3000 import SimulatedUltra3000

STEP = 0.1  # s
CYCLE = 20.0  # s of one press cycle
TRIP_EVERY = 45.0
TRIP_FOR = 8.0
OVERCURRENT = 0x2310


@dataclass(frozen=True, slots=True)
class Shown:
    """A device of the plant: its name, its line, and what is worth watching."""

    name: str
    line: str
    profile: str
    address: int
    points: tuple[str, ...]


SHOWN = (
    Shown("infeed", "press", "flexmax", 0, ("speed_setpoint", "actual_speed")),
    Shown("press", "press", "flexmax", 1, ("speed_setpoint", "actual_speed")),
    Shown("winder", "press", "flexmax", 3, ("speed_setpoint", "actual_speed")),
    Shown("unwinder", "press", "ax-v", 2, ("ipa_1009",)),
    Shown("vessel", "vessel", "53mc5000", 0, ("C101", "C100", "C102")),
    Shown("axis", "axis", "ultra3000", 0, ("motor_velocity", "motor_position")),
)


class DemoPlant:
    """Three FlexMax drives and an AX-V, a 53MC5000, an Ultra3000: paced lines, and who runs them."""

    def __init__(self) -> None:
        self.infeed = FlexMax(0, behind=dgfc386(0))
        self.press = FlexMax(1)
        self.winder = FlexMax(3)
        self.unwinder = ax_v(2)
        self.vessel = Controller(0)
        self.axis = SimulatedUltra3000(0, load_profile("ultra3000"))
        self._level = 0.0  # the setpoint of the vessel as it was set last
        self._drives = [self.infeed, self.press, self.winder]
        self.lines = {
            "press": _paced("slink3", [*self._drives, self.unwinder]),
            "vessel": _paced("datalink", [SimulatedInstrument(0, self.vessel)]),
            "axis": _paced("ultra3000", [self.axis]),
        }

    async def run(self) -> None:
        """Operate the plant until cancelled."""
        loop = asyncio.get_running_loop()
        started = loop.time()
        for drive in self._drives:
            for word in (SHUTDOWN, SWITCH_ON, ENABLE_OPERATION):
                drive.drive.control(word, loop.time())
        self.axis.servo.enable(True, loop.time())
        self.press.drive.set_speed(1450, loop.time())
        while True:
            now = loop.time()
            self._set(now - started, now)
            await asyncio.sleep(STEP)

    def _set(self, elapsed: float, now: float) -> None:
        angle = 2 * math.pi * elapsed / CYCLE
        self.infeed.drive.set_speed(round(900 + 300 * math.sin(angle)), now)
        self.winder.drive.set_speed(round(700 + 500 * math.cos(angle / 2)), now)
        tension = self.unwinder.parameters.known[(1009, 0)]
        tension.value = round(125 + 20 * math.sin(3 * angle))
        setpoint = 60.0 if elapsed % (2 * CYCLE) < CYCLE else 40.0
        if setpoint != self._level:  # in between it is whoever writes it who says
            self._level = setpoint
            self.vessel.memory.set_real(101, setpoint)
        self.axis.servo.set_velocity(round(80_000 * math.sin(angle)), now)
        self._trip(elapsed, now)

    def _trip(self, elapsed: float, now: float) -> None:
        """The winder trips on overcurrent, and after a while somebody clears it and starts it again."""
        tripped = elapsed % TRIP_EVERY > TRIP_EVERY - TRIP_FOR
        drive = self.winder.drive
        if tripped and not drive.in_fault:
            drive.trip(OVERCURRENT, now)
        elif drive.in_fault and not tripped:
            for word in (0, FAULT_RESET, 0, SHUTDOWN, SWITCH_ON, ENABLE_OPERATION):
                drive.control(word, now)


def _paced(protocol: str, devices: list[SimulatedDevice]) -> SimulatedLine:
    line = PROTOCOLS[protocol].line
    return SimulatedLine(devices, line.decoder, pace=Pace(line.character, answer_delay=0.003))
