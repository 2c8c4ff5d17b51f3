"""The tables of the Wireshark dissector, written from the protocols' own: one truth, two languages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path

from multidrop.protocols.datalink import Command as DatalinkCommand
from multidrop.protocols.datalink.frame import MOST_DATA, SOH
from multidrop.protocols.slink3 import Command, Format, Response
from multidrop.protocols.slink3.frame import START
from multidrop.protocols.slink3.messages import (
    READS,
    WRITES,
    command_name,
    response_meaning,
    type_name,
)
from multidrop.protocols.slink3.values import decode_value, width
from multidrop.protocols.ultra3000.frame import LONGEST
from multidrop.protocols.ultra3000.frame import READS as ULTRA_READS
from multidrop.protocols.ultra3000.messages import WRITES as ULTRA_WRITES
from multidrop.protocols.ultra3000.messages import function_name, refusal_meaning

LUA = Path("../src/multidrop/wireshark/multidrop.lua")  # from docs/
MARKED = re.compile(r"(^-- tables: begin\n).*?(^-- tables: end$)", re.DOTALL | re.MULTILINE)


def with_tables(text: str) -> str:
    """The dissector with its tables as they should be."""
    return MARKED.sub(lambda found: f"{found[1]}{tables()}{found[2]}", text)


def tables() -> str:
    """All of them, as Lua."""
    commands = {item.value: item.name.lower().replace("_", " ") for item in DatalinkCommand}
    typed = [Command.READ_TYPED_PARAMETER, Command.WRITE_TYPED_PARAMETER]
    standard = [Command.READ_STANDARD_PARAMETER, Command.WRITE_STANDARD_PARAMETER]
    parts = [
        _rows("SLINK3_COMMANDS", range(0x10000), 4, command_name),
        _rows("SLINK3_RESPONSES", range(0x10000), 4, response_meaning),
        _rows("SLINK3_TYPES", range(0x20), 2, type_name),
        _map("SLINK3_LAYOUTS", {item.value: f'"{_layout(item)}"' for item in Format}),
        _set("SLINK3_TYPED", typed),
        _set("SLINK3_STANDARD", standard),
        _set("SLINK3_READS", READS),
        _set("SLINK3_SUCCESS", [Response.OK, Response.OK_BROADCAST]),
        f"local SLINK3_START = {START:#04x}\n",
        f"local SLINK3_STATUS_WORD = {Command.STATUS_WORD.value:#06x}\n",
        f"local SLINK3_MALFUNCTION_CODE = {Command.MALFUNCTION_CODE.value:#06x}\n",
        _rows("DATALINK_COMMANDS", sorted(commands), 2, commands.__getitem__),
        *(f"local DATALINK_{item.name} = {item.value:#04x}\n" for item in DatalinkCommand),
        f"local DATALINK_SOH = {SOH:#04x}\n",
        f"local DATALINK_MOST_DATA = {MOST_DATA}\n",
        _rows("ULTRA3000_FUNCTIONS", range(0x10), 1, function_name),
        _rows("ULTRA3000_REFUSALS", range(0x100), 2, refusal_meaning),
        _set("ULTRA3000_READS", ULTRA_READS),
        _set("ULTRA3000_WRITES", ULTRA_WRITES),
        f"local ULTRA3000_LONGEST = {LONGEST}\n",
    ]
    assert set(typed) | set(standard) == READS | WRITES
    return "".join(parts)


def _rows(name: str, codes: Iterable[int], digits: int, word: Callable[[int], str]) -> str:
    """First, last and text of each run of codes that are worded alike but for their number."""
    runs: list[tuple[int, int, str]] = []
    for code in codes:
        text = word(code).replace("%", "%%").replace(f" {code:0{digits}X}h", f" %0{digits}Xh")
        text = text.replace(f"type{code:0{digits}X}h", f"type%0{digits}Xh")
        if runs and runs[-1][1:] == (code - 1, text) and "%" in text:
            runs[-1] = (runs[-1][0], code, text)
        else:
            runs.append((code, code, text))
    wide = max(digits, 2)
    lines = [
        f'   {{ 0x{first:0{wide}X}, 0x{last:0{wide}X}, "{text}" }},\n' for first, last, text in runs
    ]
    return f"local {name} = {{\n{''.join(lines)}}}\n"


def _layout(type_code: Format) -> str:
    """`i2`, `u4`, `f4`, `?1`: kind and bytes of a number; `string`, or `bytes` as they are."""
    size = width(type_code)
    if size is None:
        return "string" if type_code is Format.STRING else "bytes"
    value = decode_value(type_code, b"\xff" * size)
    if isinstance(value, bool):
        return f"?{size}"
    if isinstance(value, float):
        return f"f{size}"
    return f"{'i' if value == -1 else 'u'}{size}"


def _map(name: str, entries: dict[int, str]) -> str:
    body = "".join(f"   [0x{code:02X}] = {text},\n" for code, text in entries.items())
    return f"local {name} = {{\n{body}}}\n"


def _set(name: str, codes: Iterable[int]) -> str:
    body = ", ".join(f"[0x{int(code):02X}] = true" for code in sorted(codes))
    return f"local {name} = {{ {body} }}\n"
