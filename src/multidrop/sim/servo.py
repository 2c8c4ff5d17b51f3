"""A servo that behaves: enable, velocity and position, homing, faults. Every method takes the time."""

from __future__ import annotations

ACCELERATION = 200_000.0  # counts/s^2
HOMING_TIME = 1.0  # s
ROLLOVER = 1 << 32

# Bits of the drive status (manual p. 123)
_ZERO_SPEED, _UP_TO_SPEED, _ENABLED, _BUS, _FAULT, _READY = (
    1 << 2,
    1 << 6,
    1 << 7,
    1 << 8,
    1 << 9,
    1 << 15,
)


class Servo:
    """One axis in host mode: its velocity follows a setpoint while it is enabled."""

    def __init__(self) -> None:
        self.enabled = False
        self.faults = 0  # bits of the fault status (manual p. 138)
        self.cause = 0  # faults that a reset cannot clear, since their cause is still there
        self.setpoint = 0  # counts/s
        self._velocity = 0.0
        self._position = 0.0
        self._at = 0.0

    def enable(self, on: bool, now: float) -> None:
        self._advance(now)
        self.enabled = on and not self.faults

    def set_velocity(self, counts_per_second: int, now: float) -> None:
        self._advance(now)
        self.setpoint = counts_per_second

    def trip(self, faults: int, now: float) -> None:
        self._advance(now)
        self.faults |= faults
        self.enabled = self.enabled and not faults

    def reset_faults(self, now: float) -> None:
        self._advance(now)
        self.faults &= self.cause

    def define_home(self, position: int, now: float) -> None:
        self._advance(now)
        self._position = float(position)

    def velocity(self, now: float) -> int:
        self._advance(now)
        return round(self._velocity)

    def position(self, now: float) -> int:
        """Counts, rolled over to 32 bits with sign."""
        self._advance(now)
        return (round(self._position) + ROLLOVER // 2) % ROLLOVER - ROLLOVER // 2

    def drive_status(self, now: float) -> int:
        velocity = self.velocity(now)
        word = _BUS
        word |= _ZERO_SPEED if velocity == 0 else 0
        word |= _UP_TO_SPEED if self.enabled and velocity == self.setpoint else 0
        word |= _ENABLED if self.enabled else 0
        return word | (_FAULT if self.faults else _READY)

    def run_status(self) -> int:
        """FFh disabled, 00h enabled, else the code of the lowest fault: its bit number plus 1."""
        if self.faults:
            return (self.faults & -self.faults).bit_length()
        return 0x00 if self.enabled else 0xFF

    def _advance(self, now: float) -> None:
        elapsed, self._at = max(0.0, now - self._at), now
        target = float(self.setpoint) if self.enabled else 0.0
        ramp = abs(target - self._velocity) / ACCELERATION  # s until the target is reached
        ramping = min(elapsed, ramp)
        step = ACCELERATION * ramping if target > self._velocity else -ACCELERATION * ramping
        self._position += (self._velocity + step / 2) * ramping + target * (elapsed - ramping)
        self._velocity = target if elapsed >= ramp else self._velocity + step
