"""A process controller that controls: four PID loops in 64 KiB of memory, one scan every 0.1 s.

All of it lives in memory, where its datapoints are (map A); a host that changes
a byte there changes the loop. Each loop has a first-order process behind it.
"""

from __future__ import annotations

from multidrop.protocols.datalink.memory import MAP_A, MAP_IDENTIFIER_AT, MemoryMap
from multidrop.protocols.datalink.reals import decode_real, encode_real
from multidrop.protocols.datalink.values import encode_value

SCAN = 0.1  # s
LOOPS = 4
TIME_CONSTANT = 5.0  # s of the simulated process
PROCESS_GAIN = 0.9  # of the span, at full output
MOST_SCANS = 20
"""So many a controller catches up with at most, where nobody let it scan for long."""

C_STEP, L_STEP = 36, 24  # points from one loop to the next


class Memory:
    """64 KiB, and the points of a map in it."""

    def __init__(self, memory_map: MemoryMap) -> None:
        self.map = memory_map
        self.raw = bytearray(0x10000)

    def real(self, number: int) -> float:
        at = self.map.locate("C", number)
        return decode_real(bytes(self.raw[at : at + 3]))

    def set_real(self, number: int, value: float) -> None:
        at = self.map.locate("C", number)
        self.raw[at : at + 3] = encode_real(value, 3)

    def bit(self, number: int) -> bool:
        return bool(self.raw[self.map.locate("L", number)] >> number % 8 & 1)

    def set_bit(self, number: int, value: bool) -> None:
        at = self.map.locate("L", number)
        mask = 1 << number % 8
        self.raw[at] = self.raw[at] & ~mask | (mask if value else 0)

    def set_text(self, letter: str, number: int, text: str) -> None:
        at = self.map.locate(letter, number)
        raw = encode_value(letter, text, 10 if letter == "A" else 5)
        self.raw[at : at + len(raw)] = raw


class Loop:
    """One PID loop; `c` and `b` are its first C and L point (100 and 104 for loop 0)."""

    def __init__(self, memory: Memory, number: int) -> None:
        self._memory = memory
        self._c = 100 + C_STEP * number
        self._l = 104 + L_STEP * number
        self._value = 0.0  # of the process, finer than its datapoint shows
        self._integral = 0.0
        self._last_deviation = 0.0
        defaults = {1: 50.0, 3: 100.0, 4: 0.0, 5: 2.0, 6: 50.0, 7: 0.1, 9: 100.0, 11: 50.0, 13: 1.0}
        defaults |= {15: 100.0, 25: 100.0, 26: 0.0}
        for offset, value in defaults.items():
            self._set(offset, value)
        for offset in (2, 3, 8, 10, 11, 18):  # reverse, auto status and switch, enables, hard limit
            self._set_bit(offset, True)

    def scan(self) -> None:
        """What one scan of the controller does with this loop."""
        automatic = self._bit(8) and self._bit(10)
        remote = self._bit(9) and self._bit(11)
        self._set_bit(3, automatic)
        self._set_bit(4, remote)
        setpoint = self._setpoint(remote)
        output = self._control(setpoint) if automatic else self._hold()
        self._set(2, output)
        self._process(output)
        self._alarms()

    def _setpoint(self, remote: bool) -> float:
        if remote:  # SP = RSP x K1 + B1
            self._set(1, self._c_value(20) * self._c_value(13) + self._c_value(12))
        high, low = self._c_value(25), self._c_value(26)
        setpoint = min(max(self._c_value(1), low), high) if high > low else self._c_value(1)
        slew, used = self._c_value(17), self._c_value(19)
        if slew > 0:
            setpoint = min(max(setpoint, used - slew), used + slew)
        self._set(19, setpoint)
        return setpoint

    def _control(self, setpoint: float) -> float:
        """The PID module, in % of the span; reset time in minutes per repeat, 0 for none."""
        span = self._c_value(15) or 1.0
        error = (setpoint - self._c_value(0)) / span * 100
        if not self._bit(2):  # not reversed: the output rises with the process variable
            error = -error
        self._set(21, error)
        gain = 100 / max(self._c_value(6), 1e-3)
        rate = self._c_value(8) * 60 * (error - self._last_deviation) / SCAN
        self._last_deviation = error
        proportional = gain * (error + rate)
        reset = self._c_value(7)
        low, high = self._c_value(10), self._c_value(9)
        if reset > 0:
            step = gain * error * SCAN / (reset * 60)
            self._integral = min(
                max(self._integral + step, low - proportional), high - proportional
            )
            output = proportional + self._integral
        else:
            output = proportional + self._c_value(11)
        output = min(max(output, low), high)
        self._set(23, output)
        slew, last = self._c_value(18), self._c_value(2)
        return min(max(output, last - slew), last + slew) if slew > 0 else output

    def _hold(self) -> float:
        """Manual: the output stays where somebody put it, and automatic will start from there."""
        output = self._c_value(2)
        if self._bit(18):
            output = min(max(output, self._c_value(10)), self._c_value(9))
        self._integral = output
        return output

    def _process(self, output: float) -> None:
        span, low = self._c_value(15), self._c_value(16)
        target = low + span * PROCESS_GAIN * output / 100
        self._value += (target - self._value) * SCAN / TIME_CONSTANT
        self._set(0, self._value)

    def _alarms(self) -> None:
        """Alarm 1 above its limit, alarm 2 below; each goes when the dead band is left."""
        value, band = self._c_value(0), self._c_value(5)
        high, low = self._c_value(3), self._c_value(4)
        self._set_bit(6, value > high or (self._bit(6) and value > high - band))
        self._set_bit(7, value < low or (self._bit(7) and value < low + band))

    def _c_value(self, offset: int) -> float:
        return self._memory.real(self._c + offset)

    def _set(self, offset: int, value: float) -> None:
        self._memory.set_real(self._c + offset, value)

    def _bit(self, offset: int) -> bool:
        return self._memory.bit(self._l + offset)

    def _set_bit(self, offset: int, value: bool) -> None:
        self._memory.set_bit(self._l + offset, value)


class Controller:
    """A 53MC5000: memory, loops, and changes that act at the end of a scan."""

    def __init__(self, address: int) -> None:
        self.memory = Memory(MAP_A)
        self.memory.raw[MAP_IDENTIFIER_AT] = 6
        self.memory.raw[MAP_A.locate("B", 1)] = address
        self.memory.raw[MAP_A.locate("B", 2)] = 6  # 9600 baud
        self.memory.set_text("A", 8, "SIMULATED")
        self.memory.set_text("A", 190, "53MC5000")
        self.loops = [Loop(self.memory, number) for number in range(LOOPS)]
        self._scans = 0  # so many are over

    def advance(self, now: float) -> None:
        """Scan until `now`."""
        due = int(now / SCAN)
        for _ in range(min(due - self._scans, MOST_SCANS)):
            for loop in self.loops:
                loop.scan()
        self._scans = max(due, self._scans)

    def end_of_scan(self, now: float) -> float:
        """When the scan that runs at `now` ends."""
        return (int(now / SCAN) + 1) * SCAN
