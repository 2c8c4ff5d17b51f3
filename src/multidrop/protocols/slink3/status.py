"""DRIVECOM status word, control word and malfunction code families (profile 21)."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """Device states, by their DRIVECOM names."""

    NOT_READY_TO_SWITCH_ON = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch-on disabled"
    READY_TO_SWITCH_ON = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"
    UNDEFINED = "undefined"


_STATES = (  # (mask, value): no low byte matches two rows, 208 of 256 match none
    (0x4F, 0x00, State.NOT_READY_TO_SWITCH_ON),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY_TO_SWITCH_ON),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.OPERATION_ENABLED),
    (0x6F, 0x07, State.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, State.FAULT_REACTION_ACTIVE),
    (0x4F, 0x08, State.FAULT),
)

BITS = (  # what a 1 means: disable voltage and quick stop are active where bits 4 and 5 are 0
    "ready to switch on",
    "switched on",
    "operation enabled",
    "fault",
    "voltage not disabled",
    "no quick stop",
    "switch-on disabled",
    "warning",
    "message",
    "remote",
    "set value reached",
    "limit value",
    "reserved 12",
    "reserved 13",
    "free 14",
    "free 15",
)

REMOTE = 0x0200

CONTROL_WORD = 0x6040
STATUS_WORD = 0x6041
SPEED_SETPOINT = 0x6042
ACTUAL_SPEED = 0x6044
MALFUNCTION_CODE = 0x603F

SHUTDOWN = 0x06
SWITCH_ON = 0x07
ENABLE_OPERATION = 0x0F
QUICK_STOP = 0x02
DISABLE_VOLTAGE = 0x00
FAULT_RESET = 0x80  # acts on its rising edge


def state(status_word: int) -> State:
    """The state that a status word, 0..FFFFh, says."""
    for mask, value, name in _STATES:
        if status_word & mask == value:
            return name
    return State.UNDEFINED


def bits_set(status_word: int) -> list[str]:
    """The names of the bits that are 1."""
    return [name for bit, name in enumerate(BITS) if status_word >> bit & 1]


_FAMILIES = {
    0x2: "current",
    0x3: "voltage",
    0x4: "temperature",
    0x5: "device hardware",
    0x7: "additional modules and sensors",
    0x8: "monitoring",
    0x9: "external fault",
}


def malfunction_family(code: int) -> str | None:
    """The DRIVECOM family of a malfunction code, 0..FFFFh; None for none (0) or an unlisted family."""
    if code >> 8 == 0xFF:
        return "vendor-specific"
    return _FAMILIES.get(code >> 12)
