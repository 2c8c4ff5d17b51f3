"""The frames of a capture one by one, as they are on the wire."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import datetime
from functools import lru_cache
from typing import Any

from multidrop.device import ProtocolModule
from multidrop.events import Damaged, FrameReceived
from multidrop.io.captured import Interface, Packet
from multidrop.tools.captures.records import utc

_ARROWS = {None: " ", True: ">", False: "<"}
_DIRECTIONS = {None: None, True: "sent", False: "received"}
Event = FrameReceived[Any] | Damaged


@lru_cache(maxsize=64)
def _protocol(link_type: int) -> ProtocolModule | None:
    return Interface(link_type).protocol


def events(packet: Packet, protocol: ProtocolModule | None, interface: Interface) -> list[Event]:
    """What is in a packet: one frame, or damage; more of them in captures of other programs."""
    if packet.damaged:
        return [Damaged(packet.data, packet.comment or "damaged")]
    if protocol is None:
        return [Damaged(packet.data, "no known protocol")]
    decoder = interface.settings(protocol).decoder() if interface.own else protocol.decoder()
    return [*decoder.receive_data(packet.data), *decoder.silence()]


def as_json(number: int, packet: Packet, interface: Interface) -> str:
    """A line for each frame: its fields by their names, bytes in hex."""
    protocol = _protocol(interface.link_type)
    lines = []
    for event in events(packet, protocol, interface):
        known: dict[str, Any] = {
            "v": 1,
            "number": number,
            "time": utc(packet.time_ns),
            "direction": _DIRECTIONS[packet.sent],
            "protocol": protocol.name if protocol is not None else None,
            "raw": event.raw.hex(),
        }
        if isinstance(event, Damaged):
            known["error"] = {"kind": "damaged", "text": event.reason}
        else:
            for name, value in event.frame._asdict().items():
                known[name] = value.hex() if isinstance(value, bytes) else value
        lines.append(json.dumps(known) + "\n")
    return "".join(lines)


def as_text(number: int, packet: Packet, interface: Interface) -> str:
    """A line for each frame: number, local time, direction, bytes, meaning."""
    protocol = _protocol(interface.link_type)
    clock = datetime.fromtimestamp(packet.time_ns // 10**9)
    time = f"{clock:%Y-%m-%d %H:%M:%S}.{packet.time_ns // 10**6 % 1000:03d}"
    lines = []
    for event in events(packet, protocol, interface):
        raw = event.raw.hex(" ").upper()
        if isinstance(event, Damaged):
            text = f"! {event.reason}"
        else:
            assert protocol is not None
            text = protocol.describe(event.frame)
        lines.append(f"{number:>6}  {time} {_ARROWS[packet.sent]} {raw}  | {text}\n")
    return "".join(lines)


STYLES: dict[str, Callable[[int, Packet, Interface], str]] = {
    "frames": as_text,
    "frames-json": as_json,
}
