"""Words by name, and a frame in one line."""

from __future__ import annotations

import pytest

from multidrop.protocols.ultra3000 import Frame, status
from multidrop.protocols.ultra3000.describe import describe, from_master


def test_every_bit_but_one_has_a_name() -> None:
    assert len(status.DRIVE_STATUS) == len(status.FAULT_STATUS) == 32
    assert [bit for bit, name in enumerate(status.DRIVE_STATUS) if not name] == [24]


def test_bits_by_name() -> None:
    assert status.bits_set(0x00008180, status.DRIVE_STATUS) == ["enabled", "bus charged", "ready"]
    assert status.bits_set(1 << 24, status.DRIVE_STATUS) == ["bit 24"]
    assert status.bits_set(1 << 5 | 1 << 1, status.EXTENDED_FAULT_STATUS) == [
        "ground fault",
        "bit 5",
    ]
    assert status.bits_set(0, status.FAULT_STATUS) == []


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0xFF, "disabled, not faulted"),
        (0x00, "enabled"),
        (0x04, "E04 motor thermostat"),
        (0x0B, "E11 illegal Hall state"),
        (0x13, "E19 following error"),
        (0x16, "E22 motor thermal filter"),
        (0x1F, "E31 encoder data corrupt"),
        (0x21, "E33 absolute position over the rollover"),
        (0x25, "E37 AC phase loss"),
        (0x27, "E39 self-sensing commutation"),
        (0x37, "E55 user memory checksum at power-up"),
        (0x26, "E38 unlisted fault"),
    ],
)
def test_run_status(code: int, text: str) -> None:
    assert status.run_status(code) == text


def test_products() -> None:
    assert (
        status.product(0x02000015)
        == "2 kW 230 V, indexing, Ultra3000 hardware, DeviceNet option card"
    )
    assert status.product(0x0B000000) == "drive type 0Bh"
    assert status.product(0x0A000040) == "22 kW 460 V, bit 6"


@pytest.mark.parametrize(
    ("frame", "text", "master"),
    [
        (Frame(0, 0x073), "0 073 read working", True),
        (Frame(0, 0x073, 0, "00008180"), "0 073 read working = 00008180", False),
        (Frame(42, 0x06D, 1, "000186A0"), "42 06D write working := 000186A0", True),
        (Frame(42, 0x06D, 1), "42 06D write working", False),
        (Frame(0, 0x011, 5), "0 011 copy working to non volatile", True),
        (Frame(0, 0x05B, 7, "03"), "0 05B copy default := 03", True),
        (Frame(0, 0x843, 1, "05"), "0 043 write working refused: above the maximum", False),
        (Frame(0, 0x843, 1, "005"), "0 043 write working refused: 005 ?", False),
        (Frame(0, 0x843, 1, ""), "0 043 write working refused: nothing ?", False),
        (Frame(0, 0x043, 13), "0 043 reserved function Dh", True),
    ],
)
def test_a_frame_in_one_line(frame: Frame, text: str, master: bool) -> None:
    assert describe(frame) == text
    assert from_master(frame) is master
