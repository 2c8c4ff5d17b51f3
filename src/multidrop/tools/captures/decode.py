"""Decodes captures of any length: in parts, on several processors, in order, in little memory.

The work on a part begins some packets before it, and what comes out of those is
left away: a transaction that is open where a part ends comes out of the next.
"""

from __future__ import annotations

import gc
import os
import signal
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing import get_context
from typing import NamedTuple

from multidrop.device import ProtocolModule
from multidrop.io.captured import CaptureReader, Interface, Packet
from multidrop.observer import Found
from multidrop.profile import Profile
from multidrop.protocols import PROTOCOLS
from multidrop.tools.captures import frames
from multidrop.tools.captures.following import Follower, FrameFollower, RawFollower
from multidrop.tools.captures.listened import Listened, of_interface
from multidrop.tools.captures.records import STYLES, Filter, Shown
from multidrop.tools.captures.tally import Tally

PART = 4 << 20  # bytes of a file: some 60 MB of work
BEFORE = 64  # packets that a part's work begins earlier
BACK_NS = 10**9
"""A clock that goes back by more was set, or two captures were put together."""
PAUSE_NS = 3600 * 10**9
"""Without a packet for so long, all was silent, or the clock was set."""


class Part(NamedTuple):
    """Packets from `start` on (the beginning of a block), wanted from `begin` on, up to `end`.

    The work on the next part begins at `following`, which is before `end`.
    """

    start: int
    begin: int
    end: int
    first: int  # number of the packet at `start`, counted from 1
    following: int
    last: bool = False


@dataclass(slots=True)
class Done:
    """What became of a part."""

    end: int  # where in the file
    text: str = ""
    tally: Tally = field(default_factory=Tally)
    notes: list[str] = field(default_factory=list)  # what the user should know of it
    seconds: float = 0.0
    broken: bool = False  # what is behind cannot be read


@dataclass(frozen=True, slots=True)
class Decoding:
    """What is wanted of a capture.

    `profiles` and `names` go before what the capture says of its devices;
    `protocol` is for lines of bytes of no known protocol.
    """

    style: str = "text"  # of `STYLES`, or `frames`, `frames-json`
    wanted: Filter = field(default_factory=Filter)
    protocol: str | None = None
    profiles: Mapping[int, Profile] = field(default_factory=dict)
    names: Mapping[int, str] = field(default_factory=dict)

    def follower(self, interface: Interface, notes: list[str]) -> Follower:
        """Follows a line of the capture. Raises `UsageError` for a profile of another protocol."""
        if interface.protocol is not None:
            return FrameFollower(self.listened(interface, interface.protocol, notes))
        among = PROTOCOLS if self.protocol is None else {self.protocol: PROTOCOLS[self.protocol]}
        return RawFollower(lambda found: self.listened(interface, found, notes), among)

    def listened(
        self, interface: Interface, protocol: ProtocolModule, notes: list[str]
    ) -> Listened:
        """The line of an interface; what the capture says of it and nobody knows goes to `notes`."""
        line, unknown = of_interface(interface, protocol, self.profiles, self.names)
        notes += unknown
        return line


# -- one part ------------------------------------------------------------------------------------


class _Work:
    """The work on one part."""

    def __init__(self, reader: CaptureReader, decoding: Decoding, base_ns: int, part: Part) -> None:
        self._reader = reader
        self._decoding = decoding
        self._base_ns = base_ns
        self._part = part
        self._followers: dict[int, Follower] = {}
        self._heard_at: dict[int, int] = {}  # where in the file each line was heard last
        self._number = part.first - 1
        self._last_ns: int | None = None
        self._out: list[str] = []
        self._done = Done(part.end)
        shown: type[Shown] = STYLES.get(decoding.style, Shown)
        self._shown = shown(decoding.wanted, lambda at: base_ns + round(at * 1e9))

    def run(self) -> Done:
        reader, part, done = self._reader, self._part, self._done
        packets = reader.packets(part.start, part.end)
        # not kept in self: that would refer to itself, and stay in memory
        take = self._show_packet if self._decoding.style in frames.STYLES else self._follow
        if part.begin > part.start:
            for packet in packets:
                take(packet)
                if reader.at >= part.begin:
                    break
            self._out.clear()
            done.tally, done.notes = Tally(), []
        for packet in packets:
            take(packet)
        self._finish(reader.size if reader.ending else part.following)
        if reader.ending:
            done.notes.append(reader.ending)
            done.broken = True
        done.text = "".join(self._out)
        if self._last_ns is not None:
            done.seconds = (self._last_ns - self._base_ns) / 1e9
        return done

    def _follow(self, packet: Packet) -> None:
        _, time_ns, _, _, number = packet
        self._number += 1
        self._check_clock(time_ns)
        follower = self._followers.get(number)
        if follower is None:
            interface = self._reader.interfaces[number]
            follower = self._decoding.follower(interface, self._done.notes)
            self._followers[number] = follower
        self._heard_at[number] = self._reader.at
        found = follower.packet(packet, (time_ns - self._base_ns) / 1e9)
        if found:
            self._show(follower.line, found)

    def _show_packet(self, packet: Packet) -> None:
        self._number += 1
        self._check_clock(packet.time_ns)
        interface = self._reader.interfaces[packet.interface]
        self._out.append(frames.STYLES[self._decoding.style](self._number, packet, interface))
        self._done.tally.frames += not packet.damaged
        self._done.tally.damaged += packet.damaged

    def _show(self, line: Listened | None, found: list[Found]) -> None:
        for item in found:
            self._done.tally.count(item, line)
            self._out.append(self._shown(item, line))

    def _finish(self, at: int) -> None:
        """What is open on the lines that were not heard behind `at`."""
        for number, follower in self._followers.items():
            if self._heard_at[number] <= at:
                self._show(follower.line, follower.finish())

    def _check_clock(self, time_ns: int) -> None:
        last, self._last_ns = self._last_ns, time_ns
        if last is None or -BACK_NS <= time_ns - last < PAUSE_NS:
            return
        where = f"packet {self._number}"
        if time_ns < last:
            back = (last - time_ns) / 1e9
            self._done.notes.append(f"{where}: the clock goes back by {back:,.1f} s")
            self._finish(self._reader.size)  # nothing belongs together across that
        else:
            hours = (time_ns - last) / 3600e9
            self._done.notes.append(
                f"{where}: nothing for {hours:,.1f} hours, or the clock was set"
            )


def decode_part(reader: CaptureReader, decoding: Decoding, base_ns: int, part: Part) -> Done:
    """Decode a part. Raises `UsageError` where a profile does not fit its line."""
    return _Work(reader, decoding, base_ns, part).run()


# -- the whole -----------------------------------------------------------------------------------


def parts(reader: CaptureReader, size: int = PART) -> Iterator[tuple[CaptureReader, Part]]:
    """Cuts a capture; each part with a reader that knows the interfaces before it."""
    here = reader.copy()
    start = begin = at = 0
    first = number = 1
    while True:
        at, skipped = reader.skip(at, at + size)
        number += skipped
        if at + size // 2 >= reader.size:
            break
        boundary = _boundary(reader, at)
        if boundary is None:
            continue
        yield here, Part(start, begin, boundary, first, at)
        here = reader.copy()
        start, begin, first = at, boundary, number
    yield here, Part(start, begin, reader.size, first, reader.size, last=True)


def _boundary(reader: CaptureReader, start: int) -> int | None:
    """Where a part may begin whose work begins at `start`; None on lines of no known protocol."""
    probe = reader.copy()
    for packet in islice(probe.packets(start), BEFORE):
        if probe.interfaces[packet.interface].protocol is None:
            return None
    return probe.at


def decode(
    path: str, decoding: Decoding, *, processes: int | None = None, size: int = PART
) -> Iterator[Done]:
    """Decode a capture; what came of its parts, in order.

    Raises `UsageError` where the file is no capture, or a profile does not fit.
    """
    reader = CaptureReader(path)
    first = next(reader.copy().packets(), None)
    if first is None:
        yield Done(reader.size, notes=["holds no packets"])
        return
    processes = processes or _processors()
    if reader.size <= 2 * size:
        processes = 1
    for done in _in_order(reader, decoding, first.time_ns, size, processes):
        yield done
        if done.broken:
            return


def _in_order(
    reader: CaptureReader, decoding: Decoding, base_ns: int, size: int, processes: int
) -> Iterator[Done]:
    if processes == 1:
        for here, part in parts(reader, size):
            yield decode_part(here, decoding, base_ns, part)
        return
    context = get_context("spawn")
    with ProcessPoolExecutor(processes, context, initializer=_begin_process) as pool:
        waiting: deque[Future[Done]] = deque()
        try:
            for here, part in parts(reader, size):
                waiting.append(pool.submit(decode_part, here, decoding, base_ns, part))
                if len(waiting) > processes + 1:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _begin_process() -> None:
    """Ctrl-C goes to the whole group, and it is the parent's to end the work.

    Nothing here refers to itself, so looking for garbage is in vain: an eighth of the time.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()
