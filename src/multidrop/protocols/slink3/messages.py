"""What stands in COMMAND, RESPONSE and DATA: FlexMax manual (A) chapters 3 to 11.

Tables first, then the bodies of the services as frozen values with `encode`
and `decode`.
"""

from __future__ import annotations

from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

from multidrop.errors import UsageError
from multidrop.protocols.slink3.values import HAS_SUBINDEX, TYPE_BITS, Format


class Command(IntEnum):
    """All commands of A chapter 3. What a dialect implements is in `dialects.py`."""

    RESET_SLAVE = 0x0020
    STATE_READ = 0x0021
    STATE_CHANGE = 0x0022
    STATUS_WORD = 0x0023
    READ_STANDARD_PARAMETER = 0x0024
    WRITE_STANDARD_PARAMETER = 0x0025
    READ_TYPED_PARAMETER = 0x0026
    WRITE_TYPED_PARAMETER = 0x0027
    BROADCAST_COMMAND_VERIFY = 0x0028
    PARAMETER_UPLOAD = 0x0029
    PARAMETER_DOWNLOAD = 0x002A
    CONTINUE_TRANSFER = 0x002B
    MULTIPLE_PARAMETERS_READ = 0x002C
    REMOTE_KEYPAD = 0x002D
    SLAVE_DESCRIPTION = 0x002E
    MALFUNCTION_CODE = 0x002F
    READ_OBJECT_DICTIONARY = 0x0030
    WRITE_OBJECT_DICTIONARY = 0x0031
    SEQUENCE = 0x0032
    END_SEQUENCE = 0x0033
    RESET_SEQUENCE = 0x0034
    RUN_COMMAND_SEQUENCE = 0x0035
    END_TRANSFER = 0x0036
    SPECIAL_ACCESS = 0xABCD


READS = frozenset({Command.READ_TYPED_PARAMETER, Command.READ_STANDARD_PARAMETER})
WRITES = frozenset({Command.WRITE_TYPED_PARAMETER, Command.WRITE_STANDARD_PARAMETER})


def command_name(code: int) -> str:
    """The name of any COMMAND, implemented or not."""
    if code in Command._value2member_map_:
        return Command(code).name.lower().replace("_", " ")
    if 0x0050 <= code <= 0x009F:
        return f"not used {code:04X}h"
    return f"user defined {code:04X}h" if 0x0100 <= code <= 0xFF00 else f"unknown {code:04X}h"


class Response(IntEnum):
    """The RESPONSE codes of A chapter 4 that carry a meaning."""

    OK = 0x0000
    PARAMETER_NOT_EXIST = 0x0001
    CONTROL_ACCESS_DENIED = 0x0003
    ATTRIBUTE_ACCESS_DENIED = 0x0005
    TYPE_VALUE_ERROR = 0x0006
    DESTINATION_NOT_EXIST = 0x0010
    PARAMETER_ACCESS_CONFLICT = 0x0011
    ABOVE_MAXIMUM = 0x0012
    BELOW_MINIMUM = 0x0013
    VALUE_NOT_SUPPORTED = 0x0014
    CONFIGURATION_CONFLICT = 0x0015
    COMMAND_SUBMITTED = 0x0016
    UNKNOWN_COMMAND = 0x0018
    READ_ONLY_PARAMETER = 0x0019
    WRITE_NOT_ALLOWED = 0x001A
    OUT_OF_CONSTANT_LIMITS = 0x001B
    STATE_NOT_CORRECT = 0x001C
    PASSWORD = 0x001D
    TYPE_UNKNOWN = 0x001E
    TRANSFER_ENDED = 0x0080
    OK_BROADCAST = 0x0081
    FRAME_ERROR = 0x0097
    LENGTH_ERROR = 0x00FD
    PROTOCOL_ERROR = 0x00FE
    NOT_OK = 0x00FF


_MEANINGS = {
    Response.OK: "OK",
    Response.PARAMETER_NOT_EXIST: "parameter does not exist",
    Response.CONTROL_ACCESS_DENIED: "control access denied",
    Response.ATTRIBUTE_ACCESS_DENIED: "attribute access denied",
    Response.TYPE_VALUE_ERROR: "the parameter has another type",
    Response.DESTINATION_NOT_EXIST: "destination option does not exist",
    Response.PARAMETER_ACCESS_CONFLICT: "parameter access conflict",
    Response.ABOVE_MAXIMUM: "above the maximum",
    Response.BELOW_MINIMUM: "below the minimum",
    Response.VALUE_NOT_SUPPORTED: "value not supported",
    Response.CONFIGURATION_CONFLICT: "parameter configuration conflict",
    Response.COMMAND_SUBMITTED: "command submitted, its outcome is unknown",
    Response.UNKNOWN_COMMAND: "unknown command",
    Response.READ_ONLY_PARAMETER: "the parameter is read-only",
    Response.WRITE_NOT_ALLOWED: "write not allowed",
    Response.OUT_OF_CONSTANT_LIMITS: "out of the constant limits",
    Response.STATE_NOT_CORRECT: "the state does not allow it",
    Response.PASSWORD: "password protection",
    Response.TYPE_UNKNOWN: "type unknown",
    Response.TRANSFER_ENDED: "transfer ended",
    Response.OK_BROADCAST: "a broadcast was received",
    Response.FRAME_ERROR: "frame error (parity, overrun)",
    Response.LENGTH_ERROR: "protocol error: LENGTH is wrong",
    Response.PROTOCOL_ERROR: "protocol error",
    Response.NOT_OK: "not OK",
}


def response_meaning(code: int) -> str:
    """What a RESPONSE says, for a person; reserved and user defined ones too."""
    if code in _MEANINGS:
        return _MEANINGS[Response(code)]
    return (
        f"user defined response {code:04X}h" if code >= 0x0100 else f"reserved response {code:04X}h"
    )


class _Typed(NamedTuple):
    type_code: int
    index: int  # type: ignore[assignment]  # nobody looks for a value in this tuple
    subindex: int | None = None


class TypedParameter(_Typed):
    """FORMAT, INDEX and SUBINDEX in front of a value: commands 0026 and 0027 (A 5.1 to 5.4).

    `index` 0..FFFFh, `subindex` 0..255 or None for a frame without one.
    """

    __slots__ = ()  # a tuple, as a frame is: half the time of a dataclass

    def __new__(cls, type_code: int, index: int, subindex: int | None = None) -> TypedParameter:
        _check_index(index, subindex)
        if not 0 <= type_code <= TYPE_BITS:
            raise UsageError(f"type code {type_code} is out of range: 0..1Fh")
        return tuple.__new__(cls, (type_code, index, subindex))

    def encode(self) -> bytes:
        type_code, index, subindex = self
        if subindex is None:
            return bytes((type_code, index & 0xFF, index >> 8))
        return bytes((type_code | HAS_SUBINDEX, index & 0xFF, index >> 8, subindex))

    @classmethod
    def decode(cls, data: bytes) -> tuple[TypedParameter, bytes] | None:
        """The parameter at the front of DATA and what is left (VALUE); None if DATA is too short."""
        if len(data) < 3:
            return None
        type_code, index = data[0] & TYPE_BITS, data[1] | data[2] << 8  # in range, so unchecked
        if not data[0] & HAS_SUBINDEX:
            return tuple.__new__(cls, (type_code, index, None)), data[3:]
        if len(data) < 4:
            return None
        return tuple.__new__(cls, (type_code, index, data[3])), data[4:]


class _Standard(NamedTuple):
    index: int  # type: ignore[assignment]
    subindex: int = 0


class StandardParameter(_Standard):
    """INDEX and SUBINDEX of a Drivecom parameter: commands 0024 and 0025 (A 5.5 to 5.8)."""

    __slots__ = ()

    def __new__(cls, index: int, subindex: int = 0) -> StandardParameter:
        _check_index(index, subindex)
        return tuple.__new__(cls, (index, subindex))

    def encode(self) -> bytes:
        return bytes((self.index & 0xFF, self.index >> 8, self.subindex))

    @classmethod
    def decode(cls, data: bytes) -> tuple[StandardParameter, bytes] | None:
        """The parameter at the front of DATA and what is left (VALUE); None if DATA is too short."""
        if len(data) < 3:
            return None
        return cls(data[0] | data[1] << 8, data[2]), data[3:]


def _check_index(index: int, subindex: int | None) -> None:
    if not 0 <= index <= 0xFFFF:
        raise UsageError(f"index {index} is out of range: 0..65535")
    if subindex is not None and not 0 <= subindex <= 0xFF:
        raise UsageError(f"subindex {subindex} is out of range: 0..255")


@lru_cache(256)
def type_name(type_code: int) -> str:
    """The name of a type code on the wire, known or not."""
    known = type_code in Format._value2member_map_
    return Format(type_code).type_name if known else f"type{type_code:02X}h"
