"""Who is in fault, by the bits of answers and by words."""

from __future__ import annotations

from multidrop.gateway.fault_watch import FaultChange, FaultWatch
from multidrop.gateway.values import Update
from multidrop.io.poller import Quality
from unit.gateway.updates import update

BIT = 0x0200


def changes(*updates: Update) -> list[str]:
    """What the watch said at each update, if anything."""
    said: list[FaultChange] = []
    watch = FaultWatch()
    watch.listeners.append(said.append)
    found = []
    for one in updates:
        watch.take(one)
        found.append(f"{said[-1].device} {said[-1].change}" if said else "")
        said.clear()
    return found


def test_the_fault_bit_of_an_answer() -> None:
    ok, bad = update(fault=False), update(fault=True)
    assert changes(ok, ok, bad, bad, ok, bad) == [
        "infeed clear",
        "",
        "infeed tripped",
        "",
        "infeed clear",
        "infeed tripped",
    ]


def test_any_point_of_the_device_tells_it() -> None:
    assert changes(
        update(name="slow", fault=False),
        update(name="fast", fault=True),
        update(name="slow", fault=False),
    ) == ["infeed clear", "infeed tripped", "infeed clear"]


def test_a_device_that_is_found_in_fault_was_not_seen_to_trip() -> None:
    assert changes(update(fault=True)) == ["infeed found in fault"]


def test_a_fault_word() -> None:
    assert changes(
        update(value=0x8081, mask=BIT),
        update(value=0x8281, mask=BIT),
        update(value=0x8000, mask=BIT),
    ) == ["infeed clear", "infeed tripped", "infeed clear"]
    assert changes(update(value=True, mask=1)) == ["infeed found in fault"]


def test_a_card_has_a_fault_bit_of_its_own() -> None:
    card_ok, card_bad = (update(name="card", fault=said, destination=2) for said in (False, True))
    assert changes(
        update(fault=False), card_ok, card_bad, update(fault=False), card_bad, card_ok
    ) == ["infeed clear", "", "infeed tripped", "", "", "infeed clear"]


def test_what_was_not_just_read_says_nothing() -> None:
    for quality in set(Quality) - {Quality.GOOD}:
        assert changes(update(quality=quality, fault=True)) == [""]
    assert changes(update(fault=None)) == [""]
    assert changes(update(value="text", mask=1), update(value=1.5, mask=1)) == ["", ""]


def test_the_state_of_each_device() -> None:
    watch = FaultWatch()
    watch.take(update("a", fault=True))
    watch.take(update("b", fault=False))
    assert [watch.state(name) for name in "abc"] == [True, False, None]
    watch.keep_only([("b", "speed"), ("c", "speed")])
    assert [watch.state(name) for name in "abc"] == [None, False, None]


def test_a_fault_word_that_is_not_polled_any_more_says_nothing() -> None:
    watch = FaultWatch()
    watch.take(update(name="word", value=BIT, mask=BIT))
    watch.take(update(name="speed", fault=False))
    watch.keep_only([("infeed", "word"), ("infeed", "speed")])
    assert watch.state("infeed") is True
    watch.keep_only([("infeed", "speed")])
    assert watch.state("infeed") is False, "by the bit of its answers"
    watch.take(update(name="word", value=BIT, mask=BIT))
    watch.keep_only([("infeed", "other")])
    assert watch.state("infeed") is False
    only = FaultWatch()
    only.take(update(name="word", value=BIT, mask=BIT))
    only.keep_only([("infeed", "speed")])
    assert only.state("infeed") is None
