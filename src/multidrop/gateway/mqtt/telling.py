"""What the MQTT side tells of itself. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

from multidrop.gateway.telling import Metric, Trouble, full


@dataclass(frozen=True, slots=True)
class MqttState:
    """`error`: why nothing goes to the broker. `waiting`: states it has not confirmed.

    `hours`: how long it may be away at the present rate. The last two are None without an outbox.
    """

    error: str | None
    waiting: int | None = None
    hours: float | None = None


def metrics_of(state: MqttState) -> Iterator[Metric]:
    for name, meaning, value in (
        ("up", "whether the broker takes what comes", float(state.error is None)),
        ("waiting_states", "states that the broker has not confirmed", state.waiting),
        ("outbox_hours", "how long the broker may be away at the present rate", state.hours),
    ):
        yield Metric(f"mqtt_{name}", "gauge", meaning, value)


def away(broker: str, state: MqttState, since: datetime, left: float | None) -> Trouble:
    """The broker is away; `left` is for how many hours there is room on the disk."""
    text = f"Nothing goes to the MQTT broker {broker}: {state.error}."
    if state.waiting is None:
        text += " Only the newest state of each point waits for it."
    else:
        room = "; there is no room for more, so the oldest go" if full(left) else ""
        text += f" {state.waiting:,} states wait on the disk{room}."
    return Trouble(text, since, losing=full(left), hours=left)


def in_memory(state: MqttState, since: datetime) -> Trouble:
    """The disk takes nothing."""
    text = (
        f"What waits for the MQTT broker cannot be put on the disk: {state.error}. "
        f"{state.waiting:,} states wait in memory."
    )
    return Trouble(text, since, losing=True)
