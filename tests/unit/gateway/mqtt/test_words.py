"""Topics of MQTT, and which messages are commands."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.errors import UsageError
from multidrop.gateway.mqtt.commands import Command, may_answer
from multidrop.gateway.mqtt.topics import Topics, checked_topic, level, node


@given(st.text(min_size=1), st.text(min_size=1))
def test_a_name_is_one_level_and_no_two_names_the_same(one: str, other: str) -> None:
    assert not set(level(one)) & set("/+#\x00\n")
    assert (level(one) == level(other)) == (one == other)
    assert (node(one) == node(other)) == (one == other)
    topics = Topics("plant/a")
    assert topics.is_command(f"{topics.state((one, other))}/set")
    assert not topics.is_command(topics.state((one, other)))


def test_what_is_a_command() -> None:
    topics = Topics("plant/a")
    assert topics.is_command("plant/a/drive/speed/set")
    for other in ("plant/a/drive/set", "plant/b/drive/speed/set", "plant/a/x/drive/speed/set"):
        assert not topics.is_command(other)


@pytest.mark.parametrize("text", ["", "/a", "a/", "a//b", "a+", "#", "$SYS/a", "a\nb"])
def test_what_is_no_first_part_of_topics(text: str) -> None:
    with pytest.raises(UsageError, match=r"mqtt\.topic is"):
        checked_topic(text, "mqtt.topic")


@pytest.mark.parametrize(
    ("payload", "value"), [(b"5", 5), (b" -1.5e3\n", -1500.0), (b"true", True), (b"0", 0)]
)
def test_what_is_to_be_written(payload: bytes, value: float) -> None:
    found = Command("t", payload, False, 5).number()
    assert found == value
    assert type(found) is type(value)


@given(st.binary(max_size=80))
def test_whatever_comes_is_a_number_or_refused(payload: bytes) -> None:
    try:
        value = Command("t", payload, False, 5).number()
    except UsageError:
        return
    assert value == float(payload) if not isinstance(value, bool) else payload.strip()


@pytest.mark.parametrize(("expiry", "right"), [(None, False), (0, True), (10, True), (11, False)])
def test_how_long_a_command_may_count(expiry: int | None, right: bool) -> None:
    assert (Command("t", b"5", False, expiry).refusal() is None) == right
    assert Command("t", b"5", True, expiry).refusal() is not None


def test_where_an_answer_may_go() -> None:
    assert may_answer("answers/1", "plant", "homeassistant")
    assert may_answer("planted", "plant", None)
    for bad in ("", "plant", "plant/x", "homeassistant/x", "a/+", "a/#", "$SYS/x"):
        assert not may_answer(bad, "plant", "homeassistant")
