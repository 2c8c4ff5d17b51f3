"""What parts tell of themselves: in which words, and when it is serious."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from multidrop.gateway.history import telling as history
from multidrop.gateway.history.telling import HistoryState
from multidrop.gateway.mqtt import telling as mqtt
from multidrop.gateway.mqtt.telling import MqttState
from multidrop.gateway.telling import Trouble

SINCE = datetime(2026, 11, 22, 2, 31, tzinfo=UTC)


def test_history_that_is_written_is_no_trouble() -> None:
    assert history.trouble_of(HistoryState(None, 12, 3, 40.0), SINCE, 40.0, waits=True) is None


def test_a_database_that_is_away_is_serious_once_the_outbox_is_full() -> None:
    state = HistoryState("connection refused", 8120, 0, 40.0)
    waits = (
        "The database does not take the history: connection refused. 8,120 samples wait on the disk"
    )
    assert history.trouble_of(state, SINCE, 36.5, waits=True) == Trouble(
        f"{waits}.", SINCE, losing=False, hours=36.5
    )
    assert history.trouble_of(state, SINCE, None, waits=True) == Trouble(
        f"{waits}.", SINCE, losing=False
    )
    assert history.trouble_of(state, SINCE, 0.001, waits=True) == Trouble(
        f"{waits}; there is no room for more, so the oldest go.", SINCE, losing=True, hours=0.001
    )


@pytest.mark.parametrize(("lost", "said"), [(0, ""), (7, "; 7 had no room and are lost")])
def test_a_disk_that_takes_no_history_is_serious(lost: int, said: str) -> None:
    state = HistoryState("disk is full", 812, lost, None)
    text = f"History is not recorded: disk is full. 812 samples wait in memory{said}."
    assert history.trouble_of(state, SINCE, 36.5, waits=False) == Trouble(text, SINCE, losing=True)


@pytest.mark.parametrize(
    ("waiting", "left", "said", "losing"),
    [
        (None, None, " Only the newest state of each point waits for it.", False),
        (4312, 36.4, " 4,312 states wait on the disk.", False),
        (
            4312,
            0.0,
            " 4,312 states wait on the disk; there is no room for more, so the oldest go.",
            True,
        ),
    ],
)
def test_a_broker_that_is_away(
    waiting: int | None, left: float | None, said: str, losing: bool
) -> None:
    state = MqttState("connection refused", waiting, left)
    text = f"Nothing goes to the MQTT broker b:1883: connection refused.{said}"
    assert mqtt.away("b:1883", state, SINCE, left) == Trouble(text, SINCE, losing, left)


def test_metrics_have_the_names_that_are_documented() -> None:
    names = [metric.name for metric in history.metrics_of(HistoryState(None, 0, 0, None))]
    names += [metric.name for metric in mqtt.metrics_of(MqttState("away", 3, 2.0))]
    assert names == [
        "history_up",
        "history_waiting_samples",
        "history_lost_samples_total",
        "history_outbox_hours",
        "mqtt_up",
        "mqtt_waiting_states",
        "mqtt_outbox_hours",
    ]
