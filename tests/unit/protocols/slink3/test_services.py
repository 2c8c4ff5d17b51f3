"""Whether a drive says that it moves."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.conversation import Ask
from multidrop.protocols.slink3 import Frame
from multidrop.protocols.slink3.device import device


@pytest.mark.parametrize(
    ("word", "said"),
    [
        (0x0250, None),  # switch-on disabled
        (0x0233, None),  # switched on: it does not move yet
        (0x0237, "operation enabled"),
        (0x0217, "quick stop active"),
        (0x021F, "fault reaction active"),
        (0x0218, None),  # fault
    ],
)
def test_a_drive_says_whether_it_moves(word: int, said: str | None) -> None:
    asking = device(1, load_profile("flexmax"), {}).running()
    question = next(asking)
    answer = Frame(1, 0, 1, 0, word.to_bytes(2, "little"))
    assert isinstance(question, Ask)
    assert question.frame.encode() == bytes.fromhex("010100080023002A")
    with pytest.raises(StopIteration) as end:
        asking.send(answer)
    assert end.value.value == said


def test_a_card_cannot_say() -> None:
    with pytest.raises(StopIteration) as end:
        next(device(1, load_profile("dgfc386"), {}).running())
    assert end.value.value is None
