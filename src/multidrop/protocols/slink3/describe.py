"""A frame in one line, for traces and sniffers."""

from __future__ import annotations

from multidrop.errors import ProtocolError
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.messages import (
    READS,
    WRITES,
    Command,
    StandardParameter,
    TypedParameter,
    command_name,
    response_meaning,
    type_name,
)
from multidrop.protocols.slink3.values import HAS_SUBINDEX, Format, decode_value

_TYPES = frozenset(Format)
"""Bits 5-6 of FORMAT are sent 0: with them a first byte is none, but INDEX of a standard parameter."""


def describe(frame: Frame) -> str:
    """What a frame says, as far as it says it by itself."""
    where = f"/{frame.destination}" if frame.destination else ""
    number = f"#{frame.control >> 2}"
    if frame.is_answer:
        fault = " FAULT" if frame.in_fault else ""
        return (
            f"{frame.address}{where} {number}{fault} {response_meaning(frame.code)}{_answer(frame)}"
        )
    return f"{frame.address}{where} {number} {command_name(frame.code)}{_body(frame)}"


def _body(frame: Frame) -> str:
    parameter: TypedParameter | StandardParameter
    if frame.code in (Command.READ_TYPED_PARAMETER, Command.WRITE_TYPED_PARAMETER):
        typed = TypedParameter.decode(frame.data)
        if typed is not None:
            parameter, value = typed
            return f" {_typed(parameter)}{_value(parameter.type_code, value)}"
    elif frame.code in READS or frame.code in WRITES:
        standard = StandardParameter.decode(frame.data)
        if standard is not None:
            parameter, value = standard
            text = f" std/0x{parameter.index:04X}.{parameter.subindex}"
            return text + (f" := {value.hex(' ').upper()}" if value else "")
    return f" {frame.data.hex(' ').upper()}" if frame.data else ""


def _answer(frame: Frame) -> str:
    """An answer does not say what it answers: its data are shown as a typed value if they can be one."""
    typed = TypedParameter.decode(frame.data)
    if typed is not None and typed[1] and frame.data[0] & ~HAS_SUBINDEX in _TYPES:
        parameter, value = typed
        text = _value(parameter.type_code, value)
        if not text.endswith("?"):
            return f" {_typed(parameter)}{text.replace(' :=', ' =', 1)}"
    return f" {frame.data.hex(' ').upper()}" if frame.data else ""


def _typed(parameter: TypedParameter) -> str:
    subindex = "" if parameter.subindex is None else f".{parameter.subindex}"
    return f"{parameter.index}{subindex}:{type_name(parameter.type_code)}"


def _value(type_code: int, raw: bytes) -> str:
    if not raw:
        return ""
    try:
        return f" := {decode_value(Format(type_code), raw)!r}"
    except (ProtocolError, ValueError):
        return f" := {raw.hex(' ').upper()} ?"
