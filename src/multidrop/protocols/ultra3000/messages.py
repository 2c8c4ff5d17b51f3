"""What stands in the function and data fields: manual 2098-RM003A pages 1-2 and 1-3.

Array parameters begin their data with the index, two digits (functions 0 to 3
and 6 to 9).
"""

from __future__ import annotations

from enum import IntEnum

from multidrop.errors import UsageError


class Function(IntEnum):
    """The functions of page 1-2; Ch to Fh are reserved."""

    READ_WORKING = 0x0
    WRITE_WORKING = 0x1  # without data: an action
    READ_NON_VOLATILE = 0x2
    WRITE_NON_VOLATILE = 0x3  # and working
    COPY_NON_VOLATILE_TO_WORKING = 0x4
    COPY_WORKING_TO_NON_VOLATILE = 0x5
    READ_DEFAULT = 0x6
    COPY_DEFAULT = 0x7  # to non-volatile and working
    READ_MINIMUM = 0x8
    READ_MAXIMUM = 0x9
    READ_INDEX_MINIMUM = 0xA
    READ_INDEX_MAXIMUM = 0xB


WRITES = frozenset({Function.WRITE_WORKING, Function.WRITE_NON_VOLATILE})
INDEXED = frozenset(range(0x4)) | frozenset(range(0x6, 0xA))
"""The functions whose data begin with the index where the parameter is an array."""


def function_name(function: int) -> str:
    """The name of any function, reserved or not."""
    if function in Function._value2member_map_:
        return Function(function).name.lower().replace("_", " ")
    return f"reserved function {function:X}h"


class Refusal(IntEnum):
    """What a drive says with parameter + 800h: page 1-3."""

    INVALID_DATA = 0x01
    NOT_ENABLED = 0x02
    EEPROM_WRITE_ERROR = 0x03
    BELOW_MINIMUM = 0x04
    ABOVE_MAXIMUM = 0x05
    DRIVE_ENABLED = 0x06
    INVALID_INDEX = 0x07
    INVALID_FUNCTION = 0x08


_MEANINGS = {
    Refusal.INVALID_DATA: "invalid data",
    Refusal.NOT_ENABLED: "the command is not enabled",
    Refusal.EEPROM_WRITE_ERROR: "EEPROM write error",
    Refusal.BELOW_MINIMUM: "below the minimum",
    Refusal.ABOVE_MAXIMUM: "above the maximum",
    Refusal.DRIVE_ENABLED: "not while the drive is enabled",
    Refusal.INVALID_INDEX: "invalid array index",
    Refusal.INVALID_FUNCTION: "invalid function code, or no such parameter",
}


def refusal_meaning(code: int) -> str:
    """What a refusal says, for a person; unlisted ones too."""
    if code in _MEANINGS:
        return _MEANINGS[Refusal(code)]
    return f"unlisted refusal {code:02X}h"


BROADCAST = 0xFF
"""The broadcast address as drives are delivered (parameter 053)."""
NOBODY = 0xFE
"""The address that belongs to no drive and to no broadcast."""
LAST_ADDRESS = 253
LAST_PARAMETER = 0x7FF

PRODUCT_TYPE = 0x000
FIRMWARE_VERSION = 0x002
FACTORY_RESET = 0x004
RESET_FAULTS = 0x06F
DEFINE_HOME = 0x071
DRIVE_STATUS = 0x073
FAULT_STATUS = 0x074
RUN_STATUS = 0x075
START_HOMING = 0x0CD
RESET_SERIAL_PORT = 0x10A


def index_digits(index: int | None) -> str:
    """The index in front of an array's data, 0..255; nothing where there is none."""
    if index is None:
        return ""
    if not 0 <= index <= 0xFF:
        raise UsageError(f"element {index} is out of range: 0..255")
    return f"{index:02X}"
