"""What the times of answers say: pauses, late and lost ones, and adapters that hold bytes back."""

from __future__ import annotations

from collections.abc import Iterator

from multidrop.tools.doctor.answered import MOST_PROOF, TERMINATION, Context, Device
from multidrop.tools.doctor.evidence import Arrived
from multidrop.tools.doctor.verdicts import Sure, Verdict, What

LATENCY_MS = 8
"""A timer of an adapter from which on it is worth a word."""


def lost(context: Context) -> Iterator[Verdict]:
    """A device that answers, and sometimes does not."""
    for device in context.devices:
        if device.silent and device.right:
            yield Verdict(
                What.SILENT,
                Sure.CERTAIN,
                f"address {device.address} left {len(device.silent)} of {len(device.reads)} reads "
                "unanswered",
                context.proof(device.silent),
                ("a loose wire, a busy device, or requests that reach it damaged", TERMINATION),
            )


def late(context: Context) -> Iterator[Verdict]:
    """Answers that come when a master has given them up."""
    evidence = context.evidence
    limit = evidence.settings.timing(network=evidence.network).answer * 1000
    for device in context.devices:
        too_late = [read for read in device.right if read.ms > limit]
        if too_late:
            longest = max(read.ms for read in too_late)
            yield Verdict(
                What.LATE,
                Sure.CERTAIN,
                f"address {device.address} answers too late: after up to {longest:.0f} ms, {len(too_late)} "
                f"of {len(device.reads)} times over the {limit:.0f} ms that a master waits",
                context.proof(too_late),
                (f"wait longer: timeout={longest / 1000 * 1.5:.1f}",),
            )


def gap_of(context: Context, device: Device) -> float:
    """The longest rest inside an answer, s, where it is longer than a master waits; else 0."""
    evidence = context.evidence
    limit = evidence.settings.timing(network=evidence.network).silence
    longest = max((item.gap for read in device.right for item in read.answers), default=0.0)
    return longest if longest > limit else 0.0


def gaps(context: Context) -> Iterator[Verdict]:
    """Pauses within an answer at which a receiver takes it to be over."""
    evidence = context.evidence
    limit = evidence.settings.timing(network=evidence.network).silence * 1000
    for device in context.devices:
        longest = gap_of(context, device)
        if longest:
            items = [
                item for read in device.right for item in read.answers if item.gap * 1000 > limit
            ]
            yield Verdict(
                What.GAPS,
                Sure.CERTAIN,
                f"address {device.address} pauses within {len(items)} of its answers, up to "
                f"{longest * 1000:.0f} ms; a frame ends after {limit:.0f} ms",
                tuple(
                    f"{context.shown(item)}: came in {' + '.join(map(str, item.pieces))} bytes, "
                    f"{item.gap * 1000:.0f} ms apart"
                    for item in items[:MOST_PROOF]
                ),
                (
                    "an adapter or device server that holds bytes back: its latency or packing time",
                    f"wait longer within a frame: silence={longest * 1.5:.2f}",
                ),
            )


def _bursts(context: Context) -> list[Arrived]:
    """The answers that came in bursts; none where most did not, as a busy computer lets some pile up.

    Faster than the wire is a simulated line; behind a network whole answers come at once anyway.
    """
    evidence = context.evidence
    character = evidence.settings.character
    bursts, others = [], 0
    for read in (read for device in context.devices for read in device.right):
        item = read.answers[0]
        lasts = len(item.raw) * character * 1000
        if item.start < read.asked.end - 2 * character or lasts < LATENCY_MS:
            continue
        enough = len(item.pieces) > evidence.network
        if enough and lasts / len(item.pieces) >= LATENCY_MS / 2 and item.gap < LATENCY_MS / 1000:
            bursts.append(item)
        else:
            others += 1
    return bursts if len(bursts) > 2 * others else []


def latency(context: Context) -> Iterator[Verdict]:
    """Bytes that come in bursts: an adapter collects them."""
    evidence = context.evidence
    bursts, timer = _bursts(context), evidence.latency_ms
    if not bursts and (timer is None or timer < LATENCY_MS):
        return
    text = "the adapter collects bytes before it hands them over"
    if bursts:
        sizes = sorted(max(item.pieces) for item in bursts)
        together = sizes[len(sizes) // 2] * evidence.settings.character * 1000
        text += f": {together:.0f} ms of an answer come at once"
    if timer is not None:
        text += f"; its latency timer is set to {timer} ms"
    name = evidence.port.rpartition("/")[2]
    yield Verdict(
        What.LATENCY,
        Sure.LIKELY if timer is None else Sure.CERTAIN,
        text,
        tuple(
            f"{context.shown(item)}: came in {' + '.join(map(str, item.pieces))} bytes"
            for item in bursts[:2]
        ),
        (
            f"Linux: echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer"
            if not evidence.network
            else "set the packing time of the device server to a few ms",
            "Windows: device manager, the port's advanced settings",
        )[: 1 if evidence.network else 2],
    )
