"""Commands and responses by their numbers, and the bodies of the services."""

from __future__ import annotations

import pytest

from multidrop.errors import UsageError
from multidrop.protocols.slink3 import Command, Response
from multidrop.protocols.slink3.messages import (
    StandardParameter,
    TypedParameter,
    command_name,
    response_meaning,
    type_name,
)

COMMANDS = """
    0020 reset slave
    0021 state read
    0022 state change
    0023 status word
    0024 read standard parameter
    0025 write standard parameter
    0026 read typed parameter
    0027 write typed parameter
    0028 broadcast command verify
    0029 parameter upload
    002A parameter download
    002B continue transfer
    002C multiple parameters read
    002D remote keypad
    002E slave description
    002F malfunction code
    0030 read object dictionary
    0031 write object dictionary
    0032 sequence
    0033 end sequence
    0034 reset sequence
    0035 run command sequence
    0036 end transfer
    ABCD special access
"""
RESPONSES = """
    0000 OK
    0001 parameter does not exist
    0003 control access denied
    0005 attribute access denied
    0006 the parameter has another type
    0010 destination option does not exist
    0011 parameter access conflict
    0012 above the maximum
    0013 below the minimum
    0014 value not supported
    0015 parameter configuration conflict
    0016 command submitted, its outcome is unknown
    0018 unknown command
    0019 the parameter is read-only
    001A write not allowed
    001B out of the constant limits
    001C the state does not allow it
    001D password protection
    001E type unknown
    0080 transfer ended
    0081 a broadcast was received
    0097 frame error (parity, overrun)
    00FD protocol error: LENGTH is wrong
    00FE protocol error
    00FF not OK
"""


def table(text: str) -> dict[int, str]:
    rows = [line.split(maxsplit=1) for line in text.strip().splitlines()]
    return {int(code, 16): words for code, words in rows}


def test_every_command_has_its_number_and_name() -> None:
    known = table(COMMANDS)
    assert set(Command) == set(known)
    assert {code: command_name(code) for code in known} == known


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (0x004F, "unknown 004Fh"),
        (0x0050, "not used 0050h"),
        (0x009F, "not used 009Fh"),
        (0x00A0, "unknown 00A0h"),
        (0x0100, "user defined 0100h"),
        (0xFF00, "user defined FF00h"),
        (0xFF01, "unknown FF01h"),
        (0x0000, "unknown 0000h"),
    ],
)
def test_commands_without_a_name(code: int, name: str) -> None:
    assert command_name(code) == name


def test_every_response_has_its_number_and_meaning() -> None:
    known = table(RESPONSES)
    assert set(Response) == set(known)
    assert {code: response_meaning(code) for code in known} == known


@pytest.mark.parametrize(
    ("code", "meaning"),
    [
        (0x0002, "reserved response 0002h"),
        (0x007D, "reserved response 007Dh"),
        (0x0096, "reserved response 0096h"),
        (0x00FC, "reserved response 00FCh"),
        (0x0100, "user defined response 0100h"),
        (0xFFFF, "user defined response FFFFh"),
    ],
)
def test_responses_without_a_meaning(code: int, meaning: str) -> None:
    assert response_meaning(code) == meaning


@pytest.mark.parametrize(
    ("parameter", "raw"),
    [
        (TypedParameter(3, 8236), "03 2C 20"),
        (TypedParameter(3, 8236, 0), "83 2C 20 00"),
        (TypedParameter(0x1F, 0xFFFF, 255), "9F FF FF FF"),
    ],
)
def test_a_typed_parameter_both_ways(parameter: TypedParameter, raw: str) -> None:
    assert parameter.encode() == bytes.fromhex(raw)
    assert TypedParameter.decode(bytes.fromhex(raw) + b"rest") == (parameter, b"rest")


def test_reserved_bits_of_format_are_ignored() -> None:
    assert TypedParameter.decode(bytes.fromhex("63 2C 20")) == (TypedParameter(3, 8236), b"")


@pytest.mark.parametrize("raw", ["", "03", "03 2C", "83 2C 20"])
def test_a_typed_parameter_cut_short(raw: str) -> None:
    assert TypedParameter.decode(bytes.fromhex(raw)) is None


def test_a_standard_parameter_both_ways() -> None:
    parameter = StandardParameter(0x6041, 1)
    assert parameter.encode() == bytes.fromhex("41 60 01")
    assert StandardParameter.decode(bytes.fromhex("41 60 01 37 02")) == (parameter, b"\x37\x02")
    assert StandardParameter.decode(bytes.fromhex("41 60")) is None


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ((3, -1), "index -1 is out of range"),
        ((3, 65536), "index 65536 is out of range"),
        ((3, 1, -1), "subindex -1 is out of range"),
        ((3, 1, 256), "subindex 256 is out of range"),
        ((-1, 1), "type code -1 is out of range"),
        ((0x20, 1), "type code 32 is out of range"),
    ],
)
def test_what_cannot_be_said(fields: tuple[int, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        TypedParameter(*fields)


def test_a_standard_parameter_that_cannot_be_said() -> None:
    with pytest.raises(UsageError, match="index 65536 is out of range"):
        StandardParameter(65536)
    with pytest.raises(UsageError, match="subindex 256 is out of range"):
        StandardParameter(1, 256)


def test_names_of_types() -> None:
    assert [type_name(code) for code in (0, 1, 3, 8, 9, 0x0F, 0x10, 0x0B)] == [
        "auto",
        "bool",
        "int16",
        "float32",
        "string",
        "type0Fh",
        "type10h",
        "type0Bh",
    ]
