"""`multidrop check --registers`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from multidrop.cli.main import run

PLANT = """
[line.press]
port = "tcp://127.0.0.1:4001"
[line.press.device.infeed]
profile = "flexmax"
address = 0
[line.press.device.infeed.points]
torque = { at = "8236:int16", unit = "Nm", write = { min = 0, max = 1500 } }
"""


Asked = Callable[..., tuple[int, str]]


@pytest.fixture
def asked(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> Asked:
    """Exit status of `check --registers` on a plant file, and what it printed."""

    def ask(text: str, *options: str) -> tuple[int, str]:
        path = tmp_path / "multidrop.toml"
        path.write_text(text)
        status = run(["check", str(path), "--registers", *options])
        printed = capfd.readouterr()
        return status, printed.out + printed.err

    return ask


def test_the_map_as_run_will_have_it(tmp_path: Path, asked: Asked) -> None:
    head = "register,type,device,point\n"
    (tmp_path / "registers.csv").write_text(f"{head}7,int16,infeed,before\n")
    status, out = asked(PLANT + "[modbus]\n")
    assert status == 0
    rows = [line.split() for line in out.splitlines()]
    assert rows[1] == ["7", "400008", "int16", "infeed", "before", "gone"]
    assert rows[2] == ["8", "400009", "int16", "infeed", "torque", "Nm", "0..1500"]
    assert out.splitlines()[3] == f"1 not in {tmp_path}/registers.csv yet: run adds them"
    assert (tmp_path / "registers.csv").read_text() == f"{head}7,int16,infeed,before\n"


def test_the_map_as_json(asked: Asked) -> None:
    status, out = asked(PLANT + "[modbus]\n", "--json")
    assert status == 0
    assert json.loads(out) == {
        "v": 1,
        "register": 0,
        "type": "int16",
        "device": "infeed",
        "point": "torque",
        "unit": "Nm",
        "write": {"min": 0, "max": 1500},
        "gone": False,
        "filed": False,
    }


def test_a_plant_without_modbus_has_no_map(asked: Asked) -> None:
    status, out = asked(PLANT)
    assert status == 2
    assert "has no [modbus]" in out


def test_a_plant_that_is_wrong_says_so_first(asked: Asked) -> None:
    status, out = asked(PLANT.replace("8236", "xyz") + "[modbus]\n")
    assert status == 2
    assert "xyz" in out
    assert "400001" not in out
