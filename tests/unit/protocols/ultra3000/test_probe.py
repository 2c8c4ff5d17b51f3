"""Which drive answered: product type and firmware."""

from __future__ import annotations

from probing import identified

from multidrop.probing import Identity
from multidrop.protocols.ultra3000 import Frame
from multidrop.protocols.ultra3000.probe import Ultra3000Prober


def identity(known: dict[int, str]) -> tuple[Identity, list[Frame]]:
    def answer(question: Frame) -> Frame:
        if question.parameter in known:
            return question._replace(data=known[question.parameter])
        return question._replace(parameter=question.parameter + 0x800, data="08")

    return identified(Ultra3000Prober().identify(9), answer)


def test_a_drive() -> None:
    found, asked = identity({0x000: "02000005", 0x002: "010A"})
    note = "2 kW 230 V, indexing, Ultra3000 hardware, firmware 1.10"
    assert found == Identity("ultra3000", None, note)
    assert asked == [Frame(9, 0x000), Frame(9, 0x002)]


def test_a_version_of_another_width_is_left_away() -> None:
    assert identity({0x000: "01000004", 0x002: "01"})[0].note == "1 kW 230 V, Ultra3000 hardware"


def test_a_drive_that_refuses() -> None:
    found, _ = identity({})
    assert found.profile == "ultra3000"
    assert found.note.startswith("it refuses to say what it is: invalid function code")
