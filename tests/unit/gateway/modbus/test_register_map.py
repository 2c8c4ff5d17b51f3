"""The register map: nothing in it ever moves."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.catalog import load_profile
from multidrop.errors import PortError, UsageError
from multidrop.gateway.modbus.register_map import (
    BLOCK,
    REGISTERS,
    Entry,
    RegisterMap,
    RegisterType,
    keep_map,
    map_of,
    parse_map,
    register_type,
)
from multidrop.plantfile import Plant, parse_plant

FLOAT, INT16 = RegisterType.FLOAT32, RegisterType.INT16

TWO = """
[line.press]
port = "tcp://127.0.0.1:4001"
[line.press.device.infeed]
profile = "flexmax"
address = 0
[line.press.device.infeed.points]
torque = "8236:int16"
ratio = { at = "8240:int16", scale = 0.01 }
name = "8241:string"
[line.press.device.unwinder]
profile = "ax-v"
address = 2
[line.press.device.unwinder.points]
tension = "1009:int16"
"""


def plant(text: str) -> Plant:
    return parse_plant(text, "multidrop.toml", load_profile)


def test_what_stands_in_the_file_is_read_and_extended_but_not_moved(tmp_path: Path) -> None:
    path = tmp_path / "registers.csv"
    keep_map(plant(TWO), path)
    first = path.read_text()
    assert first == (
        "register,type,device,point\n"
        "0,int16,infeed,torque\n"
        "1,float32,infeed,ratio\n"
        "100,int16,unwinder,tension\n"
    )
    changed = TWO.replace('torque = "8236:int16"', 'before = "8250:uint32"').replace(
        "[line.press.device.unwinder]", "[line.press.device.rewinder]"
    )
    keep_map(plant(changed.replace("unwinder", "rewinder")), path)
    assert path.read_text() == first + "3,uint32,infeed,before\n200,int16,rewinder,tension\n"
    assert [file.name for file in tmp_path.iterdir()] == ["registers.csv"]


def test_nothing_is_written_by_looking(tmp_path: Path) -> None:
    filed, wanted = map_of(plant(TWO), tmp_path / "registers.csv")
    assert not filed.entries
    assert len(wanted.entries) == 3
    assert not list(tmp_path.iterdir())


def test_a_file_that_a_person_wrote_counts(tmp_path: Path) -> None:
    path = tmp_path / "registers.csv"
    own = "# ours\nregister,type,device,point\n\n 4000 ,float32, infeed , torque"
    path.write_text(own)
    entries = keep_map(plant(TWO), path).entries
    assert entries[0] == Entry(4000, FLOAT, "infeed", "torque")
    assert entries[1] == Entry(4002, FLOAT, "infeed", "ratio")
    assert entries[2] == Entry(4100, INT16, "unwinder", "tension")
    assert path.read_text().startswith(own + "\n4002,")


def test_a_map_that_cannot_be_kept_is_said(tmp_path: Path) -> None:
    with pytest.raises(PortError, match="the register map must be kept"):
        keep_map(plant(TWO), tmp_path / "nowhere" / "registers.csv")
    with pytest.raises(UsageError, match="directory"):
        keep_map(plant(TWO), tmp_path)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("0,int16,a", "line 2 is not register,type,device,point"),
        ("0,int16,,b", "line 2 is not register,type,device,point"),
        ("0,int61,a,b", "there is no type 'int61'"),
        ("x,int16,a,b", "'x' is no register"),
        ("-1,int16,a,b", "'-1' is no register"),
        ("65536,int16,a,b", "'65536' is no register for it, 0 to 65535"),
        ("65535,float32,a,b", "'65535' is no register for it, 0 to 65534"),
        ("7,float32,a,b\n8,int16,a,c", "a b at 7 and a c at 8 overlap"),
        ("7,float32,a,b\n9,int16,a,b", "a b stands there twice"),
    ],
)
def test_what_is_wrong_in_the_file_is_said(line: str, said: str) -> None:
    with pytest.raises(UsageError) as raised:
        parse_map(f"register,type,device,point\n{line}\n", "registers.csv")
    assert said in str(raised.value)


def test_a_file_without_its_head_is_refused() -> None:
    with pytest.raises(UsageError, match="line 1 is not the head register,type,device,point"):
        parse_map("0,int16,a,b\n", "registers.csv")


def test_a_full_map_is_said() -> None:
    full = RegisterMap([Entry(REGISTERS - 1, INT16, "last", "point")])
    with pytest.raises(UsageError, match="full"):
        full.extended([("new", "point", INT16)])


def test_registers_are_points_whole_or_nothing() -> None:
    a, b, c = Entry(0, INT16, "d", "a"), Entry(1, FLOAT, "d", "b"), Entry(5, INT16, "d", "c")
    found = RegisterMap([a, b, c])
    assert found.covering(0, 3) == [a, b]
    assert found.covering(1, 2) == [b]
    for register, count in ((0, 2), (2, 1), (1, 1), (0, 4), (3, 1), (0, 6)):
        assert found.covering(register, count) is None


names = st.sampled_from(["a", "b", "c", "d"])
points = st.lists(
    st.tuples(names, st.integers(0, 150).map(str), st.sampled_from(list(RegisterType))),
    unique_by=lambda item: item[:2],
)


@given(points, points)
def test_more_points_move_none(
    before: list[tuple[str, str, RegisterType]], after: list[tuple[str, str, RegisterType]]
) -> None:
    first = RegisterMap().extended(before)
    then = first.extended(after)
    assert then.entries[: len(first.entries)] == first.entries
    assert {entry.key for entry in then.entries} == {item[:2] for item in before + after}
    taken = [number for entry in then.entries for number in range(entry.register, entry.end)]
    assert len(taken) == len(set(taken))
    for number in {number // BLOCK for number in taken}:  # a device's block is its own
        inside = {entry.device for entry in then.entries if entry.register // BLOCK == number}
        assert len(inside) == 1
    assert parse_map(_csv(then), "x").entries == then.entries


def _csv(found: RegisterMap) -> str:
    rows = [f"{e.register},{e.type.value},{e.device},{e.point}" for e in found.entries]
    return "\n".join(["register,type,device,point", *rows])


@given(st.floats(width=32, allow_nan=False))
def test_floats_are_two_big_endian_registers_and_come_back_short(value: float) -> None:
    registers = FLOAT.to_registers(value)
    assert struct.pack(">HH", *registers) == struct.pack(">f", value)
    back = FLOAT.from_registers(registers)
    assert struct.pack(">f", back) == struct.pack(">f", value)


def test_a_decimal_comes_back_as_it_was_written() -> None:
    for value in (0.1, 12.5, 1e-7, 3.4028235e38, 16777216.0, -0.3):
        assert FLOAT.from_registers(FLOAT.to_registers(value)) == value


@pytest.mark.parametrize(
    ("kind", "value", "registers"),
    [
        (RegisterType.INT16, -2, [0xFFFE]),
        (RegisterType.UINT16, True, [1]),
        (RegisterType.UINT16, 65535.0, [0xFFFF]),
        (RegisterType.INT32, -2, [0xFFFF, 0xFFFE]),
        (RegisterType.UINT32, 0x12345678, [0x1234, 0x5678]),
        (RegisterType.FLOAT32, 1, [0x3F80, 0]),
    ],
)
def test_values_in_registers(kind: RegisterType, value: float, registers: list[int]) -> None:
    assert kind.to_registers(value) == registers
    assert kind.from_registers(registers) == value


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (RegisterType.INT16, 32768),
        (RegisterType.UINT16, -1),
        (RegisterType.INT16, 0.5),
        (RegisterType.INT32, float("inf")),
        (RegisterType.INT32, float("nan")),
        (RegisterType.FLOAT32, 1e39),
        (RegisterType.FLOAT32, "text"),
        (RegisterType.UINT16, b"\x00"),
    ],
)
def test_what_does_not_fit_is_not_made_to(kind: RegisterType, value: float | str | bytes) -> None:
    with pytest.raises(ValueError):
        kind.to_registers(value)


def test_which_type_a_point_is_offered_as() -> None:
    assert register_type("bool", 1.0) is RegisterType.UINT16
    assert register_type("int16", 0.1) is RegisterType.FLOAT32
    assert register_type("real5", 1.0) is RegisterType.FLOAT32
    assert register_type(None, 1.0) is RegisterType.FLOAT32
    assert register_type("string", 1.0) is None
