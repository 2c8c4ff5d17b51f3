"""Which protocol somebody speaks, told by the first whole frame."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.events import Damaged, FrameReceived
from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000
from multidrop.relay import MOST_GARBAGE, Recognition

REQUESTS = {
    "slink3": slink3.Frame(2, 0x7E, 0, 0x26, b"\x03\x7e\x85").encode(),
    "datalink": datalink.Frame(datalink.Command.INTERROGATE, 1, 0x0108, 1).encode(),
    "ultra3000": ultra3000.Frame(0, 0x06D).encode(),
}
"""That of SLINK3 has a whole Acknowledge of Datalink in it, that of Datalink a START."""


def recognition() -> Recognition:
    return Recognition(
        {name: protocol.decoder() for name, protocol in PROTOCOLS.items()},
        {name: protocol.relay({}) for name, protocol in PROTOCOLS.items()},
    )


def raws(events: list[FrameReceived[object] | Damaged]) -> list[bytes]:
    return [event.raw for event in events if isinstance(event, FrameReceived)]


@given(
    name=st.sampled_from(sorted(REQUESTS)),
    count=st.integers(1, 4),
    cuts=st.lists(st.integers(0, 60)),
)
def test_told_by_the_first_frame_however_it_is_cut(name: str, count: int, cuts: list[int]) -> None:
    stream = REQUESTS[name] * count
    places = [0, *sorted(cut for cut in cuts if cut < len(stream)), len(stream)]
    found = recognition()
    events = []
    for start, end in pairwise(places):
        events += found.receive_data(stream[start:end])
    assert found.protocol == name
    assert raws(events) == [REQUESTS[name]] * count
    assert not found.pending


@pytest.mark.parametrize("name", REQUESTS)
def test_nothing_is_told_by_an_answer(name: str) -> None:
    answers = {
        "slink3": slink3.Frame(2, 0, 1).encode(),
        "datalink": datalink.Frame(datalink.Command.RESPONSE, 1, 0x10, 1, b"\0").encode(),
        "ultra3000": ultra3000.Frame(0, 0x86D, 1, "05").encode(),
    }
    found = recognition()
    assert found.receive_data(answers[name]) == []
    assert found.protocol is None
    assert raws(found.receive_data(REQUESTS[name])) == [REQUESTS[name]]


def test_half_a_frame_and_silence() -> None:
    found = recognition()
    half = slink3.Frame(2, 0, 0, 0x26, bytes(200)).encode()[:40]
    assert found.receive_data(half + REQUESTS["slink3"]) == []
    assert found.pending
    assert raws(found.silence()) == [REQUESTS["slink3"]]
    assert found.protocol == "slink3"
    assert found.receive_data(b"\x01\x02") == []
    assert found.pending
    assert found.silence() == [Damaged(b"\x01\x02", "cut short")]
    assert not found.pending


def test_silence_without_a_frame() -> None:
    found = recognition()
    found.receive_data(REQUESTS["ultra3000"][:5])
    assert found.silence() == []
    assert not found.pending
    assert (found.protocol, found.hopeless) == (None, False)


def test_what_speaks_no_protocol_is_hopeless() -> None:
    found = recognition()
    found.receive_data(b"G" * 2 * MOST_GARBAGE)
    assert not found.hopeless
    assert found.receive_data(b"GG" + REQUESTS["datalink"]) == []
    assert found.hopeless
    assert found.protocol is None


def test_a_frame_behind_the_headers_of_something_else_does_not_pass() -> None:
    """A web page can make a browser send any bytes behind headers of its own."""
    found = recognition()
    assert found.receive_data(b"P" * (MOST_GARBAGE + 1) + REQUESTS["datalink"]) == []
    assert found.hopeless
    assert found.protocol is None
    found = recognition()
    found.receive_data(b"P" * MOST_GARBAGE + REQUESTS["datalink"])
    assert found.protocol == "datalink"
