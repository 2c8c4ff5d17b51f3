"""A DRIVECOM drive that behaves: states, control word, ramps, faults (profile 21)."""

from __future__ import annotations

from multidrop.protocols.slink3.status import (
    FAULT_RESET,
    REMOTE,
    SPEED_SETPOINT,
    State,
)

RAMP = 500.0  # rpm/s while operation is enabled
QUICK_STOP_RAMP = 2000.0
COAST = 100.0  # rpm/s lost by friction alone
TOP_SPEED = 3000

_WORDS = {  # state -> bits of the status word that say it
    State.NOT_READY_TO_SWITCH_ON: 0x0000,
    State.SWITCH_ON_DISABLED: 0x0040,
    State.READY_TO_SWITCH_ON: 0x0021,
    State.SWITCHED_ON: 0x0023,
    State.OPERATION_ENABLED: 0x0027,
    State.QUICK_STOP_ACTIVE: 0x0007,
    State.FAULT_REACTION_ACTIVE: 0x000F,
    State.FAULT: 0x0008,
}
_SET_VALUE_REACHED = 0x0400
_VOLTAGE = 0x0010  # 0: disable voltage is active


class Drive:
    """State machine and speed of one drive; every method takes the time."""

    def __init__(self) -> None:
        self.state = State.SWITCH_ON_DISABLED
        self.control_word = 0
        self.speed_setpoint = 0  # rpm
        self.malfunction_code = 0
        self.remote = True
        self.cause_present = False  # while it is, a fault cannot be cleared
        self._speed = 0.0
        self._at = 0.0

    @property
    def in_fault(self) -> bool:
        return self.state in (State.FAULT, State.FAULT_REACTION_ACTIVE)

    def actual_speed(self, now: float) -> int:
        """rpm at `now`."""
        self._advance(now)
        return round(self._speed)

    def status_word(self, now: float) -> int:
        self._advance(now)
        word = _WORDS[self.state]
        if self.remote:
            word |= REMOTE
        if self.control_word & 0x02:
            word |= _VOLTAGE
        if self.state is State.OPERATION_ENABLED and round(self._speed) == self.speed_setpoint:
            word |= _SET_VALUE_REACHED
        return word

    def control(self, word: int, now: float) -> None:
        """A control word, 0..FFFFh, as it is written."""
        self._advance(now)
        edge = word & FAULT_RESET and not self.control_word & FAULT_RESET
        self.control_word = word
        if self.in_fault:
            if edge and not self.cause_present:
                self.state = State.SWITCH_ON_DISABLED
                self.malfunction_code = 0
            return
        if not word & 0x02:  # disable voltage: whatever runs, coasts
            self.state = State.SWITCH_ON_DISABLED
        elif not word & 0x04:
            self._quick_stop()
        else:
            self._switch(word)

    def set_speed(self, rpm: int, now: float) -> None:
        self._advance(now)
        self.speed_setpoint = rpm

    def trip(self, code: int, now: float) -> None:
        """A fault with this malfunction code: the drive coasts."""
        self._advance(now)
        self.state = State.FAULT
        self.malfunction_code = code

    def _quick_stop(self) -> None:
        if self.state is State.OPERATION_ENABLED:
            self.state = State.QUICK_STOP_ACTIVE
        elif self.state in (State.READY_TO_SWITCH_ON, State.SWITCHED_ON):
            self.state = State.SWITCH_ON_DISABLED

    def _switch(self, word: int) -> None:
        """Shutdown (xx0), switch on (0xx1), enable operation (1xx1): one transition a word."""
        switch_on, enable = bool(word & 0x01), bool(word & 0x08)
        if self.state is State.SWITCH_ON_DISABLED:
            if not switch_on:
                self.state = State.READY_TO_SWITCH_ON
        elif self.state is State.QUICK_STOP_ACTIVE:
            if switch_on and enable:
                self.state = State.OPERATION_ENABLED
        elif not switch_on:
            self.state = State.READY_TO_SWITCH_ON
        elif self.state is State.READY_TO_SWITCH_ON or not enable:
            self.state = State.SWITCHED_ON
        else:
            self.state = State.OPERATION_ENABLED

    def _advance(self, now: float) -> None:
        """Let the speed follow until `now`."""
        elapsed, self._at = max(0.0, now - self._at), now
        if self.state is State.OPERATION_ENABLED:
            target, rate = float(self.speed_setpoint), RAMP
        elif self.state is State.QUICK_STOP_ACTIVE:
            target, rate = 0.0, QUICK_STOP_RAMP
        else:
            target, rate = 0.0, COAST
        step = rate * elapsed
        difference = target - self._speed
        self._speed += max(-step, min(step, difference))
        if self.state is State.QUICK_STOP_ACTIVE and self._speed == 0.0:
            self.state = State.SWITCH_ON_DISABLED


__all__ = ["SPEED_SETPOINT", "TOP_SPEED", "Drive"]
