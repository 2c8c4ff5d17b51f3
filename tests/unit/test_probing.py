"""When somebody who asks by himself may speak."""

from __future__ import annotations

import pytest

from multidrop.probing import next_probe_at
from multidrop.protocols import slink3
from multidrop.timing import Timing

TIMING = Timing(character=0.001, gap=0.002, answer=1.5, silence=0.03, longest_frame=255, attempts=3)
NEVER = float("-inf")


@pytest.mark.parametrize(
    ("begun", "last_heard", "at"),
    [
        (b"", NEVER, 10.0),  # nobody was heard
        (b"", 9.0, 10.0),
        (b"", 9.999, 10.001),  # the line has to rest
        (b"\x01\x02", 9.9, 10.0),
        (b"\x01\x02", 9.99, 10.02),  # somebody's frame is still coming
        (b"\x01\x02", 10.4, 10.285),  # for ever: a whole frame and a silence are the most
    ],
)
def test_when_the_next_probe_may_be_sent(begun: bytes, last_heard: float, at: float) -> None:
    decoder = slink3.decoder()
    decoder.receive_data(begun)
    assert next_probe_at(10.0, last_heard, decoder, TIMING) == pytest.approx(at)
