"""What an instrument of map A says of itself: its tag and model, its loops' modes and alarms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from multidrop.device import Report
from multidrop.protocols.datalink.points import Points
from multidrop.protocols.datalink.values import decode_value

TAG = "A8"
MODEL = ("A190", "A191")  # two parts of one text

LOOPS = range(4)
LOOP_STEP = 24  # L points from one loop to the next (N)
SETPOINT_TRACKED, OUTPUT_TRACKED = 104, 105
AUTOMATIC, REMOTE = 107, 108  # 1: automatic, remote; 0: manual, local
ALARMS = (110, 111)
HORN = "L65"
UNACKNOWLEDGED = tuple(f"L{number}" for number in range(384, 400))


def status_points(points: Points) -> list[str]:
    """The points that a status reads: tag, model, and those status bits that the profile has."""
    bits = [
        _of_loop(number, loop)
        for loop in LOOPS
        for number in (SETPOINT_TRACKED, OUTPUT_TRACKED, AUTOMATIC, REMOTE, *ALARMS)
    ]
    return [TAG, *MODEL] + [bit for bit in (*bits, HORN, *UNACKNOWLEDGED) if points.has(bit)]


def automatic_points(points: Points) -> list[str]:
    """The bits that say that a loop is in automatic, of those loops that the profile has."""
    bits = [_of_loop(AUTOMATIC, loop) for loop in LOOPS]
    return [bit for bit in bits if points.has(bit)]


_NO_SUCH: dict[str, Any] = {
    "fault": None,
    "status_word": None,
    "state": None,
    "malfunction_code": None,
}
"""What other protocols' devices have and no instrument does."""


def unknown(map_name: str) -> Report:
    """The report of an instrument whose map keeps its state in a place that no source names."""
    return Report(
        {**_NO_SUCH, "map": map_name},
        (
            f"map                {map_name}",
            "it answers; where this map keeps tag, modes and alarms is in no source",
        ),
    )


def report(map_name: str, found: Mapping[str, bytes], names: Mapping[str, str]) -> Report:
    """What the raw bytes `found` by point say; `names` are the points' names."""
    tag = str(decode_value("A", found[TAG]))
    model = str(decode_value("A", b"".join(found[part] for part in MODEL)))
    loops = [loop for loop in (_loop(number, found, names) for number in LOOPS) if loop]
    alarms = [name for loop in loops for name in loop["alarms"]]
    waiting = [names[bit] for bit in UNACKNOWLEDGED if _is_set(found, bit)]
    horn = _is_set(found, HORN)
    fields = {
        **_NO_SUCH,
        "map": map_name,
        "tag": tag,
        "model": model,
        "loops": loops,
        "alarms": alarms,
        "unacknowledged": waiting,
        "horn": horn,
    }
    lines = [f"map                {map_name}", f"tag                {tag}"]
    lines.append(f"model              {model}")
    lines += [f"loop {loop['loop']}             {_modes(loop)}" for loop in loops]
    lines += [f"alarm              {name}" for name in alarms]
    lines += [f"not acknowledged   {name}" for name in waiting]
    if horn:
        lines.append("horn               on")
    return Report(fields, tuple(lines))


def _of_loop(number: int, loop: int) -> str:
    return f"L{number + LOOP_STEP * loop}"


def _is_set(found: Mapping[str, bytes], bit: str) -> bool | None:
    """None where the profile does not have the bit."""
    return found[bit] != b"\0" if bit in found else None


def _loop(loop: int, found: Mapping[str, bytes], names: Mapping[str, str]) -> dict[str, Any]:
    """Modes and alarms of one loop; empty where the profile has none of its bits."""
    known = {
        "automatic": AUTOMATIC,
        "remote": REMOTE,
        "setpoint_tracked": SETPOINT_TRACKED,
        "output_tracked": OUTPUT_TRACKED,
    }
    modes = {word: _is_set(found, _of_loop(number, loop)) for word, number in known.items()}
    alarms = [bit for bit in (_of_loop(number, loop) for number in ALARMS) if bit in found]
    if not alarms and all(value is None for value in modes.values()):
        return {}
    return {
        "loop": loop,
        **modes,
        "alarms": [names[bit] for bit in alarms if _is_set(found, bit)],
    }


def _modes(loop: Mapping[str, Any]) -> str:
    words = {
        "automatic": ("automatic", "manual"),
        "remote": ("remote setpoint", "local setpoint"),
        "setpoint_tracked": ("setpoint tracked", ""),
        "output_tracked": ("output tracked", ""),
    }
    said = [
        on if loop[word] else off for word, (on, off) in words.items() if loop[word] is not None
    ]
    said.append("in alarm" if loop["alarms"] else "")
    return ", ".join(word for word in said if word) or "no alarm"
