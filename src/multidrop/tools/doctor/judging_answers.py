"""What a doctor's own reads say of a line and of each of its devices."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from multidrop.tools.doctor.answered import (
    MOST_PROOF,
    TERMINATION,
    WIRING,
    Answered,
    Context,
    Device,
    advice_on_settings,
    sort_out,
)
from multidrop.tools.doctor.evidence import GLITCH, Evidence
from multidrop.tools.doctor.judging_times import gap_of, gaps, late, latency, lost
from multidrop.tools.doctor.verdicts import Sure, Verdict, What


def judge_answers(evidence: Evidence) -> list[Verdict]:
    """The verdicts of the reads alone; none where nothing was asked."""
    reads = [sort_out(asked, evidence) for asked in evidence.asked]
    if not reads:
        return []
    devices: dict[int, Device] = {}
    for read in reads:
        address = read.asked.frame.address
        if read.asked.alone:
            devices.setdefault(address, Device(address)).reads.append(read)
    context = Context(evidence, reads, list(devices.values()))
    verdicts = [*_second_master(context), *_nothing(context)]
    for judge in _OF_DEVICES:
        verdicts += judge(context)
    return verdicts


# -- the line ----------------------------------------------------------------------------------


def _second_master(context: Context) -> Iterator[Verdict]:
    foreign = [(read.asked, item) for read in context.reads for item in read.foreign]
    if foreign:
        yield Verdict(
            What.SECOND_MASTER,
            Sure.CERTAIN,
            "another master speaks on this line, between our reads",
            tuple(context.shown(item, asked) for asked, item in foreign[:MOST_PROOF]),
            ("stop one of the two: two masters disturb each other", *_SHARE),
        )
    spoiled = [read for read in context.reads if _echo_spoiled(read)]
    echoes = sum(read.echo is not None for read in context.reads)
    if echoes and spoiled:
        yield Verdict(
            What.COLLISIONS,
            Sure.CERTAIN,
            f"the line hears itself, and {len(spoiled)} of {len(context.reads)} requests came back "
            "changed: somebody else sent at the same time",
            context.proof(spoiled),
            ("look for a second master, or a device that never switches its transmitter off",),
        )


_SHARE = ("several programs can share one port: multidrop share PORT",)


def _echo_spoiled(read: Answered) -> bool:
    """Bytes that began while the request was on the wire, and are not the request."""
    asked = read.asked
    halfway = (asked.start + asked.end) / 2
    return read.echo is None and any(
        item.start < halfway and len(item.raw) > GLITCH for item in read.broken
    )


def _nothing(context: Context) -> Iterator[Verdict]:
    """No answer from anybody."""
    reads, evidence = context.reads, context.evidence
    if any(read.answers or read.strays or read.damaged for read in reads):
        return
    addresses = len({read.asked.frame.address for read in reads})
    whom = f"{addresses} address{'es' if addresses != 1 else ''} at {evidence.setting}"
    proof = (context.asked(reads[0].asked),)
    elsewhere = (
        "is the device on, and is its address among those that were asked?",
        advice_on_settings(evidence.port),
    )
    if any(read.echo for read in reads):
        echo = next(read.echo for read in reads if read.echo)
        yield Verdict(
            What.ECHO_ONLY,
            Sure.CERTAIN,
            f"the line hears itself, and nobody answers ({whom}): the adapter sends, and its own "
            "receiver works",
            (*proof, f"{context.shown(echo)}: the same bytes, our own"),
            (f"{WIRING}: the devices do not hear us, or not at this setting", *elsewhere),
        )
    else:
        size = sum(read.size for read in reads)
        came = f"only {size} stray bytes came" if size else "not one byte came back"
        yield Verdict(
            What.NO_BYTES,
            Sure.CERTAIN,
            f"{came}: {len(reads)} reads of {whom}",
            proof,
            (WIRING, "two wires: does the adapter switch its transmitter off?", *elsewhere),
        )


# -- its devices -------------------------------------------------------------------------------


def _marks(context: Context) -> Iterator[Verdict]:
    """Bytes with parity or framing errors: all of them, or some."""
    reads = [read for device in context.devices for read in device.reads]
    marked, size = sum(read.marked for read in reads), sum(read.size for read in reads)
    if not marked:
        return
    whole = [item for read in reads for item in read.answers if item.marked]
    in_whole = sum(len(item.raw) for item in whole)
    proof = tuple(f"{context.shown(item)}: {item.marked} bytes marked" for item in whole[:2])
    if whole and sum(item.marked for item in whole) > 0.25 * in_whole:
        form = context.evidence.settings.format
        yield Verdict(
            What.SETTINGS,
            Sure.CERTAIN,
            f"the bytes are right and their parity is not: the devices have another format than {form}",
            proof,
            (
                "give the device's format, as in format=8N1 (or 8O1, 8E1)",
                advice_on_settings(context.evidence.port),
            ),
        )
        return
    broken = [item for read in reads for item in read.broken if item.marked]
    yield Verdict(
        What.PARITY,
        Sure.CERTAIN,
        f"{marked} of {size} bytes came with a parity or framing error ({marked / size:.1%})",
        proof + tuple(f"{context.shown(item)}: {item.marked} marked" for item in broken[:2]),
        (TERMINATION, WIRING),
    )


def _twice(context: Context) -> Iterator[Verdict]:
    for device in context.devices:
        twice = [read for read in device.reads if len(read.answers) > 1]
        if twice:
            yield Verdict(
                What.SAME_ADDRESS,
                Sure.CERTAIN if len(twice) > 1 else Sure.LIKELY,
                f"address {device.address} answers twice, {len(twice)} times of "
                f"{len(device.reads)}: two devices have this address",
                context.proof(twice),
                ("take one of them off the line, and give the other another address",),
            )


def _never_whole(context: Context) -> Iterator[Verdict]:
    """Something answers, and never a whole frame."""
    for device in context.devices:
        damaged = device.damaged
        if device.right or len(damaged) < 2 or any(read.marked for read in damaged):
            continue
        alike = len({b"".join(item.raw for item in read.broken) for read in damaged}) == 1
        if gap_of(context, device):
            continue
        yield Verdict(
            What.SETTINGS if alike else What.SAME_ADDRESS,
            Sure.LIKELY if alike else Sure.POSSIBLE,
            f"something answers at address {device.address}, each of {len(damaged)} times damaged"
            + (" in the same way: another format or baud rate" if alike else "")
            + ("" if alike else ": two devices with this address at once, or another setting"),
            context.proof(damaged),
            (
                "take the devices off the line but one, and ask again",
                advice_on_settings(context.evidence.port),
            ),
        )


def _checksums(context: Context) -> Iterator[Verdict]:
    """Some answers are damaged: how many of each device."""
    spoiled = [device for device in context.devices if device.damaged and device.right]
    if not spoiled or any(len(read.answers) > 1 for item in spoiled for read in item.reads):
        return
    rates = tuple(
        f"address {device.address}: {len(device.damaged)} of {len(device.reads)} answers damaged "
        f"({len(device.damaged) / len(device.reads):.0%})"
        for device in context.devices
        if device.reads
    )
    asked = sum(len(device.reads) for device in context.devices)
    bad = sum(len(device.damaged) for device in context.devices)
    one = len(spoiled) == 1 and len(context.devices) > 1
    where = (
        f"only those of address {spoiled[0].address}: its stub, its connector or its transmitter",
        TERMINATION,
    )
    yield Verdict(
        What.CHECKSUMS,
        Sure.CERTAIN,
        f"some answers are damaged: {bad} of {asked} ({bad / asked:.0%})",
        (*rates, *context.proof([spoiled[0].damaged[0]])),
        where if one else (TERMINATION, WIRING, "a lower baud rate, where the devices have one"),
    )


_OF_DEVICES: tuple[Callable[[Context], Iterator[Verdict]], ...] = (
    _marks,
    _twice,
    _never_whole,
    gaps,
    _checksums,
    late,
    lost,
    latency,
)
