"""What a log is told: each change once."""

from __future__ import annotations

from multidrop.gateway.news import News
from multidrop.io.poller import Quality
from unit.gateway.updates import update

LINES = {"a": "press", "b": "press", "c": "vessel"}


def said(*heard: tuple[str, Quality]) -> list[str]:
    texts: list[str] = []
    news = News(LINES.__getitem__, texts.append)
    for device, quality in heard:
        news.take(update(device, quality=quality))
    return texts


def test_a_device_falls_silent_and_answers_again() -> None:
    good, silent = Quality.GOOD, Quality.NO_REPLY
    assert said(("a", good), ("a", silent), ("a", silent), ("b", good), ("a", good)) == [
        "a: no reply",
        "a: answers again",
    ]
    assert said(("a", silent), ("a", Quality.REFUSED)) == ["a: no reply", "a: answers again"]
    assert said(("a", silent), ("a", Quality.STALE)) == ["a: no reply"]


def test_a_port_is_lost_once_for_all_its_devices() -> None:
    good, lost = Quality.GOOD, Quality.PORT_LOST
    assert said(("a", lost), ("b", lost), ("c", good), ("a", good), ("b", good)) == [
        "line press: port lost: it is gone",
        "line press: port open again",
    ]


def test_a_device_that_stays_silent_shows_that_the_port_is_back() -> None:
    assert said(("a", Quality.PORT_LOST), ("a", Quality.NO_REPLY)) == [
        "line press: port lost: it is gone",
        "a: no reply",
        "line press: port open again",
    ]
