"""Which instrument answered: by its memory map, and by the model number in it."""

from __future__ import annotations

import pytest
from probing import identified

from multidrop.probing import Identity
from multidrop.protocols.datalink import Command, Frame
from multidrop.protocols.datalink.probe import DatalinkProber


def identity(texts: dict[int, bytes], number: int = 6) -> tuple[Identity, list[Frame]]:
    memory = bytearray(0x10000)
    memory[0x8002] = number
    for at, text in texts.items():
        memory[at : at + len(text)] = text

    def answer(question: Frame) -> Frame:
        _, address, at, count, _ = question
        return Frame(Command.RESPONSE, address, at, count, bytes(memory[at : at + count]))

    return identified(DatalinkProber().identify(7), answer)


A190, A8 = 0x1400 + 1900, 0x1400 + 80


@pytest.mark.parametrize("model", ["53MC5000", "53IT5100", "53ML5100", "53SL5100"])
def test_a_model_of_map_a(model: str) -> None:
    found, asked = identity({A190: model.encode() + b"B  ", A8: b"FIC-101"})
    note = f"model number '{model}B', tag 'FIC-101'"
    assert found == Identity(model.lower(), None, note)
    assert {frame.command for frame in asked} == {Command.INTERROGATE}
    assert {frame.address for frame in asked} == {7}


def test_a_model_number_that_goes_on_in_its_second_part() -> None:
    found, _ = identity({A190: b"  CONTROLIT53MC5000  "})
    assert found == Identity("53mc5000", None, "model number 'CONTROLIT53MC5000'")


def test_map_a_and_no_model_that_is_known() -> None:
    assert identity({})[0] == Identity("datalink", None, "no model number, memory map A")
    found, _ = identity({A190: b"53QQ9999"})
    assert found == Identity("datalink", None, "model number '53QQ9999', memory map A")


def test_bytes_that_are_no_text() -> None:
    found, _ = identity({A190: b"53MC5000\x07\xe4"})
    assert found.profile == "datalink"


def test_map_b_by_its_texts() -> None:
    found, _ = identity({0x9E8: b"LIC-7"}, number=0x41)
    assert found.profile == "53sl6000"
    assert found.note.startswith("tag 'LIC-7'; ")


def test_neither_map() -> None:
    found, asked = identity({}, number=0x41)
    assert found.profile == "datalink"
    assert found.note == "memory map identifier 65, which no known map has"
    assert len(asked) == 2
