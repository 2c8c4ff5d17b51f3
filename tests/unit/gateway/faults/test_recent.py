"""What is kept of the seconds before a trip."""

from __future__ import annotations

from multidrop.gateway.faults.recent import RecentFrames, RecentValues, frames_of, utc
from multidrop.protocols import PROTOCOLS, slink3
from unit.gateway.updates import update

ANSWER = bytes.fromhex("0100000D010000446000000028")
ASKED = bytes.fromhex("0100000B0024004460000B")


def cut(ring: RecentFrames, most: int = 100) -> list[tuple[bool, str, str]]:
    found = frames_of(
        ring.pieces(), PROTOCOLS["slink3"], slink3.LINE, most, lambda now: int(now * 1e9)
    )
    return [(one["sent"], one["shown"], one["time"]) for one in found]


def test_values_of_the_last_seconds() -> None:
    recent = RecentValues(10.0)
    for at in (0.0, 3.0, 10.0, 12.9):
        recent.take(update(at=at))
    recent.take(update("other", at=50.0))
    assert [one.monotonic for one in recent.of("infeed")] == [3.0, 10.0, 12.9]
    assert len(recent.of("other")) == 1
    assert recent.of("nobody") == []


def test_frames_are_cut_from_the_bytes_of_a_line() -> None:
    ring = RecentFrames(10)
    ring(ASKED, True, 100.0, False)
    ring(ANSWER[:5], False, 100.04, False)
    ring(ANSWER[5:], False, 100.05, False)
    (sent, asked, _), (heard, answered, at) = cut(ring)
    assert (sent, asked) == (True, "01 00 00 0B 00 24 00 44 60 00 0B")
    assert (heard, answered) == (False, "01 00 00 0D 01 00 00 44 60 00 00 00 28")
    assert at == "1970-01-01T00:01:40.050000Z"


def test_damage_is_kept_with_its_reason() -> None:
    ring = RecentFrames(10)
    ring(ASKED, True, 100.0, False)
    ring(ANSWER[:-1] + b"\x00", False, 100.05, False)
    found = frames_of(ring.pieces(), PROTOCOLS["slink3"], slink3.LINE, 100, lambda now: 0)
    assert found[0]["damaged"] is False
    assert found[-1]["damaged"] is True
    assert found[-1]["text"].startswith("damaged: ")


def test_the_last_frames_are_kept_and_no_more_than_is_needed() -> None:
    ring = RecentFrames(4)
    for turn in range(1000):
        ring(ASKED, True, 100.0 + turn, False)
        ring(ANSWER, False, 100.05 + turn, False)
    assert len(ring.pieces()) <= 2 * 4 + 1
    assert [sent for sent, _, _ in cut(ring, 4)] == [True, False, True, False]
    assert cut(ring, 4)[-1][2] == utc(int(1099.05 * 1e9))


def test_frames_in_many_pieces_stay_bounded() -> None:
    ring = RecentFrames(4)
    for turn in range(100):
        ring(ASKED, True, 100.0 + turn, False)
        for place in range(len(ANSWER)):
            ring(ANSWER[place : place + 1], False, 100.01 + turn + place / 1000, False)
    assert len(ring.pieces()) <= 16 * 4
    assert len(cut(ring, 4)) == 4


def test_no_frames_where_none_are_wanted() -> None:
    ring = RecentFrames(0)
    ring(ASKED, True, 100.0, False)
    assert (ring.pieces(), cut(ring, 0)) == ([], [])
