"""When the decoder of a protocol has understood what a line speaks, and which of several has."""

from __future__ import annotations

from multidrop.protocols import PROTOCOLS, datalink, slink3
from multidrop.tools.ears import LEAST_FRAME, Ear, told

ASKED = slink3.Frame(2, 0, 4, 0x0B, b"\x00\x26").encode()
INTERROGATE = datalink.Frame(datalink.Command.INTERROGATE, 3, 0x1000, 9).encode()
ACKNOWLEDGE = datalink.Frame(datalink.Command.ACKNOWLEDGE, 3).encode()


def ear(name: str, *pieces: bytes) -> Ear:
    found = Ear(PROTOCOLS[name], PROTOCOLS[name].decoder())
    for piece in pieces:
        found.receive(piece)
    found.silence()
    return found


def test_as_many_frames_as_are_wanted() -> None:
    heard = ear("slink3", ASKED, ASKED)
    assert (heard.frames, heard.in_frames, heard.heard) == (2, 2 * len(ASKED), 2 * len(ASKED))
    assert [heard.understands(frames) for frames in (1, 2, 3)] == [True, True, False]


def test_what_came_before_the_first_frame_does_not_count() -> None:
    """Whoever begins to listen hears the end of a frame first."""
    assert ear("slink3", bytes(1000), ASKED).understands(1)


def test_frames_have_to_be_half_of_what_came_since() -> None:
    assert ear("slink3", ASKED, bytes(len(ASKED))).understands(1)
    assert not ear("slink3", ASKED, bytes(len(ASKED) + 1)).understands(1)


def test_bytes_that_the_port_marked_are_no_frame() -> None:
    heard = ear("slink3", ASKED)
    events = heard.receive(ASKED, damaged=True)
    assert b"".join(event.raw for event in events) == ASKED
    assert (heard.frames, heard.heard) == (1, 2 * len(ASKED))


def test_a_frame_without_a_checksum_proves_nothing() -> None:
    assert len(ACKNOWLEDGE) < LEAST_FRAME
    assert not ear("datalink", ACKNOWLEDGE, ACKNOWLEDGE).understands(1)
    assert ear("datalink", INTERROGATE, ACKNOWLEDGE).understands(1)


def test_of_several_the_one_that_makes_most_of_it() -> None:
    ears = [ear("slink3", ASKED), ear("datalink", INTERROGATE, INTERROGATE), ear("ultra3000")]
    assert told(ears, 1) is ears[1]
    assert told(ears[::2], 1) is ears[0]
    assert told(ears, 3) is None
    assert told([], 0) is None
