"""States that go to a broker together, and how they wait for it as bytes: JSON, compressed. Pure."""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from multidrop.gateway.gaps import Gap
from multidrop.gateway.mqtt.topics import Record

if TYPE_CHECKING:
    from multidrop.gateway.outbox import Waiting


class State(NamedTuple):
    """A state as it is published. `time` (µs) is its own; `added` (s) is when it came in here."""

    topic: str
    payload: str
    time: int
    record: Record
    added: float


@dataclass(slots=True)
class Lot:
    """States that are sent, and confirmed, together; `lost` is what went before them.

    `number` is the one that the outbox has for it, None while it is in memory only.
    """

    states: list[State]
    lost: Gap | None = None
    number: int | None = None


def packed(lot: Lot) -> tuple[bytes, int, int, int]:
    """A lot as the outbox takes it: bytes, its first and last time (µs), how many states."""
    facts = {
        "lost": None if lot.lost is None else list(_facts(lot.lost)),
        "states": [[state.topic, state.payload, state.time, *state.record] for state in lot.states],
    }
    data = zlib.compress(json.dumps(facts, separators=(",", ":")).encode(), 1)
    times = [state.time for state in lot.states]
    return data, min(times), max(times), len(lot.states)


def unpack(waiting: Waiting) -> Lot:
    """The lot again, with what the outbox had to give up before it."""
    facts = json.loads(zlib.decompress(waiting.data))
    states = [
        State(topic, payload, when, (run, number), 0.0)
        for topic, payload, when, run, number in facts["states"]
    ]
    own = None if facts["lost"] is None else Gap(*facts["lost"])
    return Lot(states, joined(waiting.lost, own), waiting.number)


def _facts(gap: Gap) -> tuple[int, int, str, int | None]:
    return gap.start, gap.end, gap.reason, gap.samples


def joined(one: Gap | None, other: Gap | None) -> Gap | None:
    """Two gaps in a row as one."""
    if one is None or other is None:
        return one or other
    count = (one.samples or 0) + (other.samples or 0)
    return Gap(min(one.start, other.start), max(one.end, other.end), one.reason, count)
