"""Drive status, fault status, run status and product type by name: manual pages 18, 123, 124, 138, 139, App. A."""

from __future__ import annotations

DRIVE_STATUS = (  # parameter 073, bits 0 to 31
    "in position",
    "within position window",
    "zero speed",
    "within speed window",
    "forward current limit",
    "reverse current limit",
    "up to speed",
    "enabled",
    "bus charged",
    "fault disable",
    "fault decel/disable",
    "fault ignore",
    "fault indicate",
    "overtravel exceeded",
    "brake",
    "ready",
    "set preset position",
    "integrator inhibit",
    "follower enable",
    "forward enable",
    "reverse enable",
    "operation mode override",
    "position strobe",
    "home sensor",
    "",
    "start index",
    "define home",
    "registration sensor",
    "remove command offset",
    "start homing",
    "fault reset",
    "drive enable",
)
ENABLED = 1 << 7

FAULT_STATUS = (  # parameter 074, bits 0 to 31
    "NV memory endurance",
    "position change over half the rollover",
    "absolute feedback range",
    "motor thermostat",
    "IPM hardware",
    "hardware overtravel",
    "encoder B line break",
    "encoder A line break",
    "bus undervoltage",
    "bus overvoltage",
    "illegal Hall state",
    "home search failed",
    "home position outside limits",
    "option card communication",
    "electrical cycle length",
    "overtravel",
    "user current",
    "motor overspeed",
    "following error",
    "motor encoder state",
    "auxiliary encoder state",
    "motor thermal filter",
    "IPM thermal filter",
    "velocity error",
    "sensor not assigned",
    "motor speed limit",
    "axis not homed",
    "smart encoder parameter",
    "encoder output frequency",
    "encoder communication",
    "encoder data corrupt",
    "encoder input frequency",
)

EXTENDED_FAULT_STATUS = (  # parameter 19E, bits 0 to 4
    "absolute position over the rollover",
    "ground fault",
    "soft-start",
    "module overtemperature",
    "AC phase loss",
)

FAULT_CODES = {
    **dict(enumerate(FAULT_STATUS, 1)),
    **dict(enumerate(EXTENDED_FAULT_STATUS, 33)),
    39: "self-sensing commutation",
    55: "user memory checksum at power-up",
}
"""Run status -> name. Most follow from the bit's number, so names are shown with the code beside them."""

RUNNING = 0x00  # run status: enabled
STOPPED = 0xFF  # run status: disabled and not faulted

DRIVE_TYPES = (  # the top byte of parameter 000
    "500 W 230 V",
    "1 kW 230 V",
    "2 kW 230 V",
    "3 kW 230 V",
    "7.5 kW 230 V",
    "15 kW 230 V",
    "3 kW 460 V",
    "5 kW 460 V",
    "10 kW 460 V",
    "15 kW 460 V",
    "22 kW 460 V",
)
PRODUCT_BITS = (  # parameter 000, bits 0 to 5
    "indexing",
    "non-indexing",
    "Ultra3000 hardware",
    "",
    "DeviceNet option card",
    "SERCOS option card",
)


def bits_set(word: int, names: tuple[str, ...]) -> list[str]:
    """The names of the bits that are 1; those without a name by their number."""
    return [
        (names[bit] if bit < len(names) else "") or f"bit {bit}"
        for bit in range(32)
        if word >> bit & 1
    ]


def run_status(code: int) -> str:
    """What parameter 075 says, 0..FFh. Codes are decimal: byte 13h is E19."""
    if code == STOPPED:
        return "disabled, not faulted"
    if code == RUNNING:
        return "enabled"
    return f"E{code:02} {FAULT_CODES.get(code, 'unlisted fault')}"


def product(word: int) -> str:
    """What parameter 000 says: the drive type, and the hardware's bits."""
    kind = word >> 24
    name = DRIVE_TYPES[kind] if kind < len(DRIVE_TYPES) else f"drive type {kind:02X}h"
    return ", ".join([name, *bits_set(word & 0xFFFFFF, PRODUCT_BITS)])
