"""Whose frame goes on a shared line next."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from multidrop.protocols.slink3 import Frame
from multidrop.tools.share.client_turns import MOST, ClientTurns, Hold


def frame(index: int, control: int = 0) -> Frame:
    return Frame(2, control, 0, 0x26, bytes((3, index & 0xFF, index >> 8)))


def turns(*clients: str) -> ClientTurns[str]:
    made: ClientTurns[str] = ClientTurns(1.0)
    for client in clients:
        made.join(client)
    return made


def order(made: ClientTurns[str], now: float = 0.0) -> str:
    """Whose turns come, one after the other."""
    found = ""
    while (turn := made.take(now)) is not None:
        found += turn.client
    return found


def test_one_frame_of_each_in_turn() -> None:
    made = turns("a", "b", "c")
    for number in range(4):
        made.put("a", frame(number), 0.0)
    made.put("b", frame(0), 0.0)
    made.put("c", frame(0), 0.0)
    made.put("c", frame(1), 0.0)
    assert order(made) == "abcacaa"


@given(st.lists(st.sampled_from("abc"), max_size=60))
def test_nobody_waits_for_two_frames_of_another(arrivals: list[str]) -> None:
    made = turns("a", "b", "c")
    for number, client in enumerate(arrivals):
        made.put(client, frame(number), 0.0)
    left = {client: made.waiting(client) for client in "abc"}
    passed_over = dict.fromkeys("abc", 0)
    for client in order(made):
        left[client] -= 1
        for other in "abc":
            waits = other != client and left[other]
            passed_over[other] = passed_over[other] + 1 if waits else 0
            assert passed_over[other] <= 2
    assert not any(left.values())


def test_each_clients_frames_keep_their_order() -> None:
    made = turns("a")
    for number in range(5):
        made.put("a", frame(number), 0.0)
    taken = [turn.frame for _ in range(5) if (turn := made.take(0.0)) is not None]
    assert taken == [frame(number) for number in range(5)]


def test_a_client_has_so_many_and_no_more() -> None:
    made = turns("a", "b")
    assert all(made.put("a", frame(number), 0.0) for number in range(MOST))
    assert not made.put("a", frame(MOST), 0.0)
    assert made.put("b", frame(0), 0.0)
    assert made.waiting("a") == MOST


def test_what_is_asked_again_is_asked_once_with_the_newer_number() -> None:
    made = turns("a", "b")
    made.put("a", frame(1, 0x04), 0.0, once=True)
    made.put("a", frame(2, 0x08), 0.1, once=True)
    assert made.put("a", frame(1, 0x0C), 0.9, once=True)
    made.put("b", frame(1, 0x04), 0.9, once=True)
    assert made.waiting("a") == 2
    first = made.take(1.5)  # the first asking alone would have been too long ago
    assert first is not None
    assert (first.client, first.frame) == ("a", frame(1, 0x0C))
    other = made.take(1.5)
    assert other is not None
    assert other.client == "b"


def test_what_nobody_answers_is_never_joined() -> None:
    made = turns("a")
    made.put("a", frame(1), 0.0)
    made.put("a", frame(1), 0.0)
    assert made.waiting("a") == 2


def test_what_waited_too_long_is_not_sent() -> None:
    made = turns("a")
    made.put("a", frame(1), 0.0)
    made.put("a", frame(2), 0.5)
    found = made.take(1.2)
    assert found is not None
    assert found.frame == frame(2)
    made.put("a", frame(3), 2.0)
    assert made.take(3.01) is None


def test_frames_that_waited_too_long_take_no_place() -> None:
    made = turns("a")
    for number in range(MOST):
        made.put("a", frame(number), 0.0)
    assert made.put("a", frame(99), 1.01)
    assert made.waiting("a") == 1


def test_the_line_is_held_for_one() -> None:
    made = turns("a", "b")
    made.put("a", frame(1), 0.0)
    made.hold = Hold("b", frame(0), 0.08)
    assert made.take(0.0) is None
    made.put("b", frame(2), 0.0)
    assert order(made) == "b"
    made.hold = None
    assert order(made) == "a"


def test_who_holds_the_line_and_goes_lets_it_go() -> None:
    made = turns("a", "b")
    made.hold = Hold("b", frame(0), 5.0)
    made.leave("a", 1.0)
    assert made.hold.until == 5.0
    made.leave("b", 1.0)
    assert made.hold == Hold("b", frame(0), 1.0)


def test_nothing_is_left_of_a_client_that_went_or_of_a_line_that_was_lost() -> None:
    made = turns("a", "b")
    made.put("a", frame(1), 0.0)
    made.put("b", frame(1), 0.0)
    made.leave("a", 0.0)
    assert order(made) == "b"
    made.put("b", frame(1), 0.0)
    made.hold = Hold("b", frame(0), 5.0)
    made.clear()
    assert made.hold is None
    assert order(made) == ""
