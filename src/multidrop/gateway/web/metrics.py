"""Metrics in the text format of Prometheus."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib.metadata import version

from multidrop.gateway.gateway import Gateway
from multidrop.io.poller import Quality

CONTENT = "text/plain; version=0.0.4; charset=utf-8"

Labels = dict[str, str]
Sample = tuple[Labels, float | None]


def text(gateway: Gateway) -> str:
    """All of them; a value that is not known is left out."""
    return "".join(_lines(gateway))


def _lines(gateway: Gateway) -> Iterator[str]:
    yield from _metric("info", "gauge", "the program", [({"version": version("multidrop")}, 1.0)])
    yield from _of_lines(gateway)
    yield from _of_devices(gateway)
    yield from _of_points(gateway)
    for part in gateway.telling():
        for name, kind, meaning, value in part.metrics():
            if value is not None:
                yield from _metric(name, kind, meaning, [({}, value)])


def _of_lines(gateway: Gateway) -> Iterator[str]:
    lines = gateway.line_health()
    for name, meaning, value in (
        ("line_up", "whether the port is open", lambda line: float(line.lost is None)),
        (
            "line_load_ratio",
            "share of the last minute in which it was used",
            lambda line: line.load,
        ),
        ("line_planned_ratio", "share of its time that the polls take", lambda line: line.planned),
    ):
        yield from _metric(
            name, "gauge", meaning, [({"line": line.name}, value(line)) for line in lines]
        )
    yield from _metric(
        "line_opened_total",
        "counter",
        "how often the port was opened",
        [({"line": line.name}, line.times_opened) for line in lines],
    )
    yield from _metric(
        "line_missed_polls_total",
        "counter",
        "polls that were left out because the line was too busy",
        [({"line": line.name}, line.missed) for line in lines],
    )
    for counter in sorted(lines[0].counters) if lines else ():
        yield from _metric(
            f"line_{counter}_total",
            "counter",
            f"{counter.replace('_', ' ')} on the line",
            [({"line": line.name}, line.counters[counter]) for line in lines],
        )


def _of_devices(gateway: Gateway) -> Iterator[str]:
    devices = [gateway.device_health(name) for name in gateway.plant.devices]
    labels = [{"device": device.name, "line": device.line} for device in devices]
    yield from _metric(
        "device_up",
        "gauge",
        "whether it answers",
        [(label, float(not item.silent)) for label, item in zip(labels, devices, strict=True)],
    )
    yield from _metric(
        "device_answer_delay_seconds",
        "gauge",
        "from the end of a question to the first byte of its answer",
        [(label, item.delay) for label, item in zip(labels, devices, strict=True)],
    )
    for counter in sorted(devices[0].counters) if devices else ():
        if counter != "delay":
            yield from _metric(
                f"device_{counter}{'_seconds' if counter == 'busy' else ''}_total",
                "counter",
                f"{counter.replace('_', ' ')} of the device",
                [
                    (label, item.counters[counter])
                    for label, item in zip(labels, devices, strict=True)
                ],
            )


def _of_points(gateway: Gateway) -> Iterator[str]:
    updates = list(gateway.values.latest.values())
    values: list[Sample] = []
    for update in updates:
        number = update.value
        if update.quality is Quality.GOOD and isinstance(number, int | float):
            unit = update.polled.point.unit or ""
            labels = {"device": update.device, "point": update.point, "unit": unit}
            values.append((labels, float(number)))
    yield from _metric("point_value", "gauge", "the value, where it is good", values)
    counted: dict[str, dict[Quality, int]] = {}
    for update in updates:
        of_device = counted.setdefault(update.device, dict.fromkeys(Quality, 0))
        of_device[update.quality] += 1
    yield from _metric(
        "points",
        "gauge",
        "points of a device by the quality of their values",
        [
            ({"device": device, "quality": quality.value}, count)
            for device, by_quality in counted.items()
            for quality, count in by_quality.items()
        ],
    )


def _metric(name: str, kind: str, meaning: str, samples: Iterable[Sample]) -> Iterator[str]:
    yield f"# HELP multidrop_{name} {meaning}\n# TYPE multidrop_{name} {kind}\n"
    for labels, value in samples:
        if value is not None:
            shown = ",".join(f'{label}="{_escaped(text)}"' for label, text in labels.items())
            braces = f"{{{shown}}}" if shown else ""
            yield f"multidrop_{name}{braces} {_number(value)}\n"


def _number(value: float) -> str:
    special = {float("inf"): "+Inf", float("-inf"): "-Inf"}
    return special.get(value, repr(value) if value == value else "NaN")


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
