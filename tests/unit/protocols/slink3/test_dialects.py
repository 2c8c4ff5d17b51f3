"""What each model has, column by column as the documents print it."""

from __future__ import annotations

import pytest

from multidrop.protocols.slink3 import AX_V, DGFC386, FLEXMAX, SLINK3, Dialect, Response
from multidrop.protocols.slink3.dialects import DIALECTS, TYPES_TO_TRY

COMMANDS = {
    "flexmax": {0x20, 0x23, 0x24, 0x25, 0x26, 0x27, 0x28, 0x2F},
    "dgfc386": {0x26, 0x27, 0xABCD},
    "ax-v": {0x26, 0x27},
    "slink3": {0x20, 0x23, 0x24, 0x25, 0x26, 0x27, 0x28, 0x2F, 0xABCD},
}
TYPES = {
    "flexmax": {3, 4, 6, 7, 8, 9},
    "dgfc386": {0, 1, 2, 3, 4, 5, 6, 7, 8},
    "ax-v": {0, 1, 3, 4, 6, 7, 8},
    "slink3": {0, 1, 2, 3, 4, 5, 6, 7, 8, 9},
}


@pytest.mark.parametrize("dialect", DIALECTS.values(), ids=lambda dialect: dialect.name)
def test_commands_and_types(dialect: Dialect) -> None:
    assert dialect.commands == COMMANDS[dialect.name]
    assert dialect.formats == TYPES[dialect.name]
    assert dialect.names_types == (0 in TYPES[dialect.name])


def test_what_else_differs() -> None:
    assert [dialect.broadcast for dialect in (FLEXMAX, DGFC386, AX_V, SLINK3)] == [
        255,
        255,
        128,
        255,
    ]
    assert [dialect.name for dialect in DIALECTS.values() if not dialect.subindex] == ["ax-v"]
    assert [dialect.name for dialect in DIALECTS.values() if not dialect.fault_bit] == ["ax-v"]
    assert [d.name for d in DIALECTS.values() if not d.frame_error_means_unread] == ["ax-v"]
    assert [dialect.behind for dialect in (FLEXMAX, DGFC386, AX_V, SLINK3)] == [
        "dgfc386",
        "flexmax",
        None,
        "dgfc386",
    ]


def test_types_are_tried_in_the_documents_order() -> None:
    assert list(TYPES_TO_TRY) == [3, 4, 6, 7, 8, 9]
    assert set(TYPES_TO_TRY) == FLEXMAX.formats


def test_an_ax_v_says_only_what_it_knows() -> None:
    """Of all that a slave says by the table of its duties, these are left (B chapter 4)."""
    duties = (0x00, 0x01, 0x06, 0x10, 0x12, 0x13, 0x18, 0x19, 0x1A, 0x1E, 0xFD)
    said = {AX_V.refusal(Response(code)) for code in duties}
    assert said == {0x00, 0x01, 0x18, 0x1E, 0x97}


def test_what_an_ax_v_says_instead() -> None:
    assert AX_V.refusal(Response.TYPE_VALUE_ERROR) is Response.TYPE_UNKNOWN
    assert AX_V.refusal(Response.ABOVE_MAXIMUM) is Response.FRAME_ERROR
    assert AX_V.refusal(Response.PARAMETER_NOT_EXIST) is Response.PARAMETER_NOT_EXIST


@pytest.mark.parametrize("dialect", [FLEXMAX, DGFC386, SLINK3], ids=lambda dialect: dialect.name)
def test_the_others_say_what_they_mean(dialect: Dialect) -> None:
    assert [dialect.refusal(response) for response in Response] == list(Response)
