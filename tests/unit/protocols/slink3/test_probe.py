"""Who answered: FlexMax, AX-V, DGFC386, or somebody else."""

from __future__ import annotations

import pytest
from probing import identified

from multidrop.probing import Identity
from multidrop.protocols.slink3 import Frame
from multidrop.protocols.slink3.probe import Slink3Prober

Known = dict[tuple[int, int, str], tuple[int, str]]
"""(destination, command, DATA) -> (RESPONSE, DATA); anything else does not exist."""

STATUS = (0, 0x23, "")
VOID_511 = (0, 0x26, "00FF01")
UCHAR_511 = (0, 0x26, "05FF01")
CARD = (2, 0x26, "05FF01")
DRIVE = (2, 0x26, "063F21")
IPA = (0, 0x26, "00F103")


def identity(known: Known) -> tuple[Identity, list[Frame]]:
    def answer(question: Frame) -> Frame:
        asked = (question.destination, question.code, question.data.hex().upper())
        code, data = known.get(asked, (0x10 if asked[0] else 0x01, ""))
        return Frame(5, question.control, question.order | 1, code, bytes.fromhex(data))

    return identified(Slink3Prober().identify(5), answer)


FLEXMAX: Known = {STATUS: (0, "5002"), VOID_511: (0x1E, "")}


def test_a_flexmax() -> None:
    found, asked = identity(FLEXMAX)
    assert found == Identity("flexmax")
    assert [frame.address for frame in asked] == [5, 5, 5]
    assert {frame.code for frame in asked} == {0x23, 0x26}


def test_a_flexmax_with_a_card_behind_it() -> None:
    found, _ = identity({**FLEXMAX, CARD: (0, "05FF0105")})
    assert (found.profile, found.behind) == ("flexmax", "dgfc386")


def test_a_drive_that_names_types_is_no_flexmax() -> None:
    found, _ = identity({STATUS: (0, "5002")})
    assert found.profile == "slink3"


@pytest.mark.parametrize(("drive", "behind"), [((0, "063F210500"), "flexmax"), ((0x10, ""), None)])
def test_a_card(drive: tuple[int, str], behind: str | None) -> None:
    known: Known = {STATUS: (0x18, ""), UCHAR_511: (0, "05FF0105"), DRIVE: drive}
    assert identity(known)[0] == Identity("dgfc386", behind)


def test_an_ax_v_by_its_types_and_by_its_parameters() -> None:
    assert identity({STATUS: (0x18, ""), UCHAR_511: (0x1E, "")})[0] == Identity("ax-v")
    found, _ = identity({STATUS: (0x18, ""), IPA: (0, "03F1037D00")})
    assert found == Identity("ax-v", note="by its IPA 1009")


def test_somebody_else() -> None:
    found, asked = identity({STATUS: (0x18, "")})
    assert found == Identity(
        "slink3", note="no status word; parameter 511: parameter does not exist"
    )
    assert len(asked) == 3
    found, asked = identity({STATUS: (0x1C, "")})
    assert found == Identity("slink3", note="status word: the state does not allow it")
    assert len(asked) == 1


def test_a_status_word_of_another_width_is_none() -> None:
    assert identity({STATUS: (0, "50")})[0].profile == "slink3"
