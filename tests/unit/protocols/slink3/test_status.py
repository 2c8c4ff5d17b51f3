"""DRIVECOM: the state of every status word, the names of its bits, the families of its codes."""

from __future__ import annotations

from collections import Counter

import pytest

from multidrop.catalog import load_profile
from multidrop.protocols.slink3 import State
from multidrop.protocols.slink3.status import BITS, bits_set, malfunction_family, state

ROWS = [  # mask, value, state: the table of the document
    (0x4F, 0x00, State.NOT_READY_TO_SWITCH_ON),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY_TO_SWITCH_ON),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.OPERATION_ENABLED),
    (0x6F, 0x07, State.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, State.FAULT_REACTION_ACTIVE),
    (0x4F, 0x08, State.FAULT),
]


@pytest.mark.parametrize("high", [0x00, 0x02, 0xFF])
def test_the_state_of_all_low_bytes(high: int) -> None:
    for low in range(256):
        matching = [name for mask, value, name in ROWS if low & mask == value]
        assert len(matching) < 2
        expected = matching[0] if matching else State.UNDEFINED
        assert state(high << 8 | low) is expected, f"{low:02X}h"


def test_how_many_low_bytes_each_state_has() -> None:
    assert Counter(state(low) for low in range(256)) == {
        State.NOT_READY_TO_SWITCH_ON: 8,
        State.SWITCH_ON_DISABLED: 8,
        State.READY_TO_SWITCH_ON: 4,
        State.SWITCHED_ON: 4,
        State.OPERATION_ENABLED: 4,
        State.QUICK_STOP_ACTIVE: 4,
        State.FAULT_REACTION_ACTIVE: 8,
        State.FAULT: 8,
        State.UNDEFINED: 208,
    }


def test_every_bit_has_a_name() -> None:
    assert bits_set(0) == []
    assert bits_set(0xFFFF) == list(BITS)
    assert len(BITS) == 16
    assert bits_set(0x0208) == ["fault", "remote"]


@pytest.mark.parametrize(
    ("code", "family"),
    [
        (0x0000, None),
        (0x1000, None),
        (0x2310, "current"),
        (0x3210, "voltage"),
        (0x4FFF, "temperature"),
        (0x5000, "device hardware"),
        (0x6000, None),
        (0x7305, "additional modules and sensors"),
        (0x8000, "monitoring"),
        (0x9000, "external fault"),
        (0xA000, None),
        (0xFEFF, None),
        (0xFF01, "vendor-specific"),
    ],
)
def test_families_of_malfunction_codes(code: int, family: str | None) -> None:
    assert malfunction_family(code) == family


def test_the_profile_names_the_same_bits() -> None:
    named = dict(enumerate(load_profile("flexmax").points["status_word"].bits))
    for bit, name in enumerate(BITS):
        free = name.startswith(("reserved", "free"))
        assert named.get(bit, "") == ("" if free else name)
