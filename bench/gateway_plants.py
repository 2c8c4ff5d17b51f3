"""The plant files of the rows of the gateway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.gateway_process import TOPIC
from bench.service_lines import BAUD, FASTER, KINDS, kind_of
from multidrop.io.connection import Target

DEVICES = 5
"""Of each line of the large plant."""


@dataclass(frozen=True, slots=True)
class Kind:
    """Devices of the large plant: how many lines of them, and what is polled of each.

    `counted` is what the simulator lets count, `more` how many fault words are polled besides.
    """

    profile: str
    lines: int
    first: int
    points: int
    text: str
    more: int = 0

    @property
    def counted(self) -> str:
        return f"{self.profile}+{self.first}-{self.first + self.points - 1}"

    def at(self, number: int) -> str:
        return self.text.format(self.first + number)


MIXED = (
    Kind("flexmax", 6, 9000, 10, "{}:int16"),
    Kind("53mc5000", 8, 100, 35, "C{}"),
    Kind("ultra3000", 6, 0x07E, 9, "0x{:03X}", more=1),
)
"""20 lines, 100 devices, 2,000 points, and no line fuller than `multidrop check` allows."""

ALONE = (Kind("flexmax", 20, 9000, 20, "{}:int16"),)
"""The same numbers, a message for each point: more than `multidrop check` allows on such lines."""


def lines_of(kinds: Sequence[Kind]) -> list[Kind]:
    """The kind of each line."""
    return [kind for kind in kinds for _ in range(kind.lines)]


def points_of(kinds: Sequence[Kind]) -> int:
    return sum(kind.lines * DEVICES * (kind.points + kind.more) for kind in kinds)


def counted_of(kinds: Sequence[Kind]) -> int:
    """Those of them whose values count."""
    return sum(kind.lines * DEVICES * kind.points for kind in kinds)


def messages_of(kinds: Sequence[Kind]) -> int:
    """Polls a second: points that stand side by side may come with one message."""
    found = 0
    for kind in kinds:
        device = Target.of(f"{kind.profile}:0@wire").device()
        points = [device.point(kind.at(number)) for number in range(kind.points)]
        found += kind.lines * DEVICES * (len(list(device.plan(points))) + kind.more)
    return found


def large(
    folder: Path,
    ports: Sequence[str],
    kinds: Sequence[Kind],
    broker: int | None,
    *,
    outbox: bool = False,
) -> Path:
    """A plant file: all points once a second, everything switched on, the outbox of MQTT where it is wanted."""
    text = []
    for number, (kind, port) in enumerate(zip(lines_of(kinds), ports, strict=True)):
        text += [f"[line.l{number}]", f'port = "{port}"', "baud = 115200"]
        for address in range(DEVICES):
            place = f"line.l{number}.device.l{number}d{address}"
            text += [f"[{place}]", f'profile = "{kind.profile}"', f"address = {address}"]
            text.append(f"[{place}.points]")
            text += [f'count{point} = "{kind.at(point)}"' for point in range(kind.points)]
    return _written(folder, text, broker, outbox=outbox)


def paced(folder: Path, ports: Sequence[str], broker: int | None) -> Path:
    """The 64 lines of the row `service`, each as full as it goes; one point of each device counts."""
    text = []
    for number, port in enumerate(ports):
        kind = kind_of(number)
        counted = COUNTED[kind.profile]
        place = f"line.l{number}.device.l{number}d0"
        text += [f"[line.l{number}]", f'port = "{port}"', f"baud = {BAUD}", "timeout = 1"]
        text += [f"[{place}]", f'profile = "{kind.profile}"', "address = 0", f"[{place}.points]"]
        for at in PACED_POINTS[kind.profile]:
            name = "count" if at == counted else f"p_{at.partition(':')[0]}"
            text.append(f'{name} = {{ at = "{at}", every = {FASTER} }}')
    return _written(folder, text, broker)


COUNTED = {"flexmax": "8236:int16", "53mc5000": "C127", "ultra3000": "0x06D"}
"""What counts."""

PACED_POINTS = {
    "flexmax": ("8236:int16", "actual_speed"),
    "53mc5000": tuple(f"C{n}" for n in (*range(100, 110), *range(120, 130))),
    "ultra3000": ("0x06D", "0x07E"),
}
"""The points of `service_lines.KINDS`, each with its text."""

PACED_KINDS = [
    f"{kind.profile}@{BAUD}+{COUNTED[kind.profile].strip('C').partition(':')[0]}" for kind in KINDS
]
"""As the simulator knows them."""


def _written(folder: Path, text: list[str], broker: int | None, *, outbox: bool = False) -> Path:
    text += ["[history]", "[faults]", "[http]", 'listen = "127.0.0.1:0"']
    if broker is not None:
        text += ["[mqtt]", 'host = "127.0.0.1"', f"port = {broker}", f'topic = "{TOPIC}"']
        text += ['outbox = "mqtt-outbox.db"'] if outbox else []
    file = folder / "multidrop.toml"
    file.write_text("\n".join([*text, ""]))
    return file
