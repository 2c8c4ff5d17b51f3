"""The demonstration plant: a press with drives that move, and now and then trip."""

from __future__ import annotations

import asyncio
import math

from multidrop.protocols import slink3
from multidrop.protocols.slink3.status import ENABLE_OPERATION, FAULT_RESET, SHUTDOWN, SWITCH_ON
from multidrop.sim.line import Pace, SimulatedLine
from multidrop.sim.slink3 import FlexMax, ax_v, card_parameters

STEP = 0.1  # s
CYCLE = 20.0  # s of one press cycle
TRIP_EVERY = 45.0
TRIP_FOR = 8.0
OVERCURRENT = 0x2310

DEVICES = {"infeed": "flexmax:0", "press": "flexmax:1", "winder": "flexmax:3", "unwinder": "ax-v:2"}
"""What is on the line, by name."""


class DemoPlant:
    """Three FlexMax drives and an AX-V on one paced line, and somebody who runs them."""

    def __init__(self) -> None:
        self.infeed = FlexMax(0, behind=card_parameters(0))
        self.press = FlexMax(1)
        self.winder = FlexMax(3)
        self.unwinder = ax_v(2)
        drives = [self.infeed, self.press, self.winder]
        self.line = SimulatedLine(
            [*drives, self.unwinder],
            slink3.decoder,
            pace=Pace(slink3.LINE.character, answer_delay=0.003),
        )
        self._drives = drives

    async def run(self) -> None:
        """Operate the plant until cancelled."""
        loop = asyncio.get_running_loop()
        started = loop.time()
        for drive in self._drives:
            for word in (SHUTDOWN, SWITCH_ON, ENABLE_OPERATION):
                drive.drive.control(word, loop.time())
        while True:
            now = loop.time()
            self._set(now - started, now)
            await asyncio.sleep(STEP)

    def _set(self, elapsed: float, now: float) -> None:
        angle = 2 * math.pi * elapsed / CYCLE
        self.infeed.drive.set_speed(round(900 + 300 * math.sin(angle)), now)
        self.press.drive.set_speed(1450, now)
        self.winder.drive.set_speed(round(700 + 500 * math.cos(angle / 2)), now)
        tension = self.unwinder.parameters.known[(1009, 0)]
        tension.value = round(125 + 20 * math.sin(3 * angle))
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
