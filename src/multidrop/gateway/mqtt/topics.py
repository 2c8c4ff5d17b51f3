"""Topics and payloads of the gateway's MQTT side. docs/reference/mqtt.md says what they mean. Pure."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from multidrop.errors import UsageError
from multidrop.gateway.gaps import Gap
from multidrop.gateway.polled import polled, target_of
from multidrop.gateway.stamps import moment, to_microseconds
from multidrop.gateway.values import Key, Update
from multidrop.io.audit import jsonable
from multidrop.plantfile import Plant, PlantDevice

ONLINE, OFFLINE = "online", "offline"

Record = tuple[int, int]
"""Run of the gateway, number in it: by it a subscriber knows a state that comes again."""

UNREAD = "not read yet"
"""The quality of a point that was not polled yet."""

ENCODE = json.JSONEncoder(ensure_ascii=False).encode
"""`json.dumps` with an argument makes an encoder for each call."""

_SPECIAL = re.compile(r"[%/+#\x00-\x1f\x7f-\x9f]")


def checked_topic(text: str, where: str) -> str:
    """A topic as the plant file gives it, as the first part of others. Raises `UsageError`."""
    parts = text.split("/")
    if not all(parts) or text.startswith("$") or re.search(r"[+#\x00-\x1f\x7f-\x9f]", text):
        raise UsageError(f"{where} is {text!r}, which is no first part of topics, such as plant/a")
    return text


@cache
def level(name: str) -> str:
    """A name as one level of a topic: what MQTT gives a meaning is written as %XX."""
    return _SPECIAL.sub(lambda found: f"%{ord(found[0]):02X}", name)


def keys_of(plant: Plant) -> Iterator[Key]:
    """Everything of a plant that is polled."""
    return ((device.name, point) for device in plant.devices.values() for point in polled(device))


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of one gateway; `base` is the first part of them all."""

    base: str

    @property
    def status(self) -> str:
        return f"{self.base}/status"

    @property
    def gap(self) -> str:
        return f"{self.base}/gap"

    @property
    def states(self) -> str:
        """The filter of all states."""
        return f"{self.base}/+/+"

    @property
    def commands(self) -> str:
        """The filter of all commands."""
        return f"{self.base}/+/+/set"

    def state(self, key: Key) -> str:
        return f"{self.base}/{level(key[0])}/{level(key[1])}"

    def is_command(self, topic: str) -> bool:
        """Whether the filter of all commands lets this topic through."""
        inside = topic.startswith(f"{self.base}/") and topic.endswith("/set")
        return inside and topic.count("/") == self.base.count("/") + 3


def state_payload(update: Update, record: Record | None = None) -> str:
    """A state. `value` is null unless it is good: an old one is `last`, with its own time."""
    reading = update.polled.reading
    facts: dict[str, Any] = {
        "value": None,
        "unit": update.polled.point.unit,
        "quality": update.quality.value,
        "time": to_microseconds(update.polled.time),
    }
    if reading is not None and update.good:
        facts |= {"value": jsonable(reading.value), "time": to_microseconds(reading.time)}
        if reading.meaning is not None:
            facts["meaning"] = reading.meaning
    elif reading is not None:
        facts |= {"last": jsonable(reading.value), "last_time": to_microseconds(reading.time)}
    if update.polled.error is not None:
        facts["error"] = str(update.polled.error)
    if record is not None:
        facts["record"] = record
    return ENCODE(facts)


def gap_payload(gap: Gap, before: Record) -> str:
    """What had no room to wait: states of this time, which were to come before that record."""
    return ENCODE(
        {
            "from": to_microseconds(moment(gap.start)),
            "until": to_microseconds(moment(gap.end)),
            "states": gap.samples,
            "reason": gap.reason,
            "before": before,
        }
    )


def unread_payload(plant: Plant, key: Key) -> str:
    """The state of a point of which nothing is known yet, in the place of one of another day."""
    known = plant.devices[key[0]].profile.points.get(key[1])
    unit = known.unit if known is not None else None
    return json.dumps({"value": None, "unit": unit, "quality": UNREAD, "time": None})


# -- Home Assistant --------------------------------------------------------------------------


def discovery(plant: Plant, topics: Topics, prefix: str) -> dict[str, str]:
    """Topic -> payload that makes Home Assistant know all points of a plant.

    They are sensors there: what Home Assistant's other entities send has no expiry,
    so it would be refused as a command.
    """
    found: dict[str, str] = {}
    for device in plant.devices.values():
        worked_out = target_of(device).device()
        for point in polled(device):
            is_bool = worked_out.point(point).type == "bool"
            kind = "binary_sensor" if is_bool else "sensor"
            identity = _identity(topics.base, device.name, point)
            place = f"{prefix}/{kind}/{node(topics.base)}/{identity}/config"
            payload = _config(device, point, topics, identity, is_bool=is_bool)
            found[place] = json.dumps(payload, ensure_ascii=False)
    return found


def node(base: str) -> str:
    """What Home Assistant's topics have for this gateway."""
    return f"multidrop_{_plain(base)}"


def discovery_filter(topics: Topics, prefix: str) -> str:
    return f"{prefix}/+/{node(topics.base)}/+/config"


def _plain(name: str) -> str:
    """A name with letters, digits and `_` only, and no two names alike."""
    return re.sub(r"[^A-Za-z0-9]", lambda found: "_" + found[0].encode().hex() + "_", name)


def _identity(*names: str) -> str:
    return "-".join(_plain(name) for name in names)


def _config(
    device: PlantDevice, point: str, topics: Topics, identity: str, *, is_bool: bool
) -> dict[str, Any]:
    state = topics.state((device.name, point))
    known = device.profile.points.get(point)
    good = f"{{{{ '{ONLINE}' if value_json.quality == 'good' else '{OFFLINE}' }}}}"
    plain = "{{ value_json.value }}"
    facts: dict[str, Any] = {
        "name": known.meaning if known is not None and known.meaning else point,
        "unique_id": identity,
        "state_topic": state,
        "value_template": "{{ 'ON' if value_json.value else 'OFF' }}" if is_bool else plain,
        "availability": [
            {"topic": topics.status},
            {"topic": state, "value_template": good},
        ],
        "availability_mode": "all",
        "json_attributes_topic": state,
        "device": {
            "identifiers": [_identity(topics.base, device.name)],
            "name": device.name,
            "model": device.profile.title,
        },
        "origin": {"name": "multidrop"},
    }
    if known is not None and known.unit and not is_bool:
        facts["unit_of_measurement"] = known.unit
    return facts
