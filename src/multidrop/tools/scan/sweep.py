"""One protocol at one setting of a line: every address is asked, and who answers is found.

No clock in here: whoever runs a sweep passes `now`, as with an `Exchange`. It is
not made of exchanges because it waits less than a device may take: an answer that
comes while others are being asked counts too.

1. The quick pass asks each address and waits `wait` s for its answer.
2. Then it listens for `LATE` s, as long as any device may take.
3. Whoever answered late is asked again alone. So is everybody who may have sent
   damaged bytes, the likeliest first, until somebody answers: bytes of two devices
   at once are damaged, and two devices with one address always are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from multidrop.device import ProtocolModule
from multidrop.events import Damaged, FrameReceived
from multidrop.exchange import LATE
from multidrop.probing import next_probe_at
from multidrop.timing import Timing

MOST_SILENT = 20
"""So many that were asked alone may be silent, or damaged again; then the damage is the line's own."""

TWICE = "more than one answer, or a damaged one beside it: two devices with this address?"
ONCE = "answered once, late, and not when it was asked again alone"


@dataclass(frozen=True, slots=True)
class Found:
    """A device that answered: `ms` from the end of the probe to the first byte of its answer."""

    ms: float
    said: str
    doubt: str = ""


@dataclass(slots=True)
class _Asked:
    """A probe that went out. `until` is the calculated end of it on the wire."""

    address: int
    frame: Any
    until: float
    wait: float
    alone: bool
    answers: int = 0
    damage: bytes = b""


@dataclass(slots=True)
class Counted:
    """What else was heard."""

    echoes: int = 0
    strays: int = 0  # whole frames that answer nothing that was asked
    damaged: int = 0
    noisy: bool = False  # damage without end: not everybody who may have sent it was asked


@dataclass(slots=True)
class _Doubts:
    """Who is to be asked again alone: those who were late, and groups of whom one sent damage."""

    late: deque[int] = field(default_factory=deque)
    groups: deque[list[int]] = field(default_factory=deque)
    asked: set[int] = field(default_factory=set)
    heard: set[int] = field(default_factory=set)  # alone, and heard then

    def next(self) -> int | None:
        while self.late:
            address = self.late.popleft()
            if address not in self.asked:
                return address
        while self.groups:
            for address in self.groups[0]:
                if address in self.heard:
                    break
                if address not in self.asked:
                    return address
            self.groups.popleft()
        return None

    def everybody(self) -> list[int]:
        return [*self.late, *(address for group in self.groups for address in group)]


class Sweep:
    """Asks `addresses`. `found` and `damaged` are who was found, `foreign` another master's request."""

    def __init__(
        self,
        protocol: ProtocolModule,
        decoder: Any,
        timing: Timing,
        addresses: Iterable[int],
        wait: float,
        *,
        anyway: bool = False,
        found: Mapping[int, Found] | None = None,
    ) -> None:
        self._protocol = protocol
        self._decoder = decoder
        self._timing = timing
        self._left = deque(addresses)
        self._wait = wait
        self._anyway = anyway
        self._asked: deque[_Asked] = deque()  # of the last LATE s
        self._slot: _Asked | None = None  # the probe whose answer is waited for
        self._doubts = _Doubts()
        self._silent = 0
        self._listened = False
        self._until = 0.0
        self._last_heard = float("-inf")
        self.found: dict[int, Found] = dict(found or {})
        self.damaged: dict[int, bytes] = {}
        self.counted = Counted()
        self.foreign: str | None = None
        self.done = False

    @property
    def left(self) -> list[int]:
        """Who is to be asked when the sweep is begun again from here."""
        unsure = [asked.address for asked in self._asked]
        unsure += [*self._doubts.everybody(), *self.damaged]
        known = {*self.found, *self._left}
        return [*dict.fromkeys(address for address in unsure if address not in known), *self._left]

    @property
    def waiting(self) -> int:
        """How many were not asked yet."""
        return len(self._left)

    @property
    def deadline(self) -> float:
        """When `advance` wants to be called even if nothing arrived."""
        return next_probe_at(self._until, self._last_heard, self._decoder, self._timing)

    def start(self, now: float) -> bytes:
        """Begin; returns the bytes to send."""
        return self._next(now)

    def advance(self, data: bytes, now: float, *, damaged: bool = False) -> bytes:
        """Take bytes that arrived, or none at the deadline; returns the bytes to send at once."""
        if data:
            self._last_heard = now
            decoder = self._decoder
            self._take(decoder.line_error(data) if damaged else decoder.receive_data(data), now)
        if self.done or now < self.deadline:
            return b""
        self._take(self._decoder.silence(), now)
        self._judge()
        return self._next(now)

    # -- asking ----------------------------------------------------------------------------

    def _next(self, now: float) -> bytes:
        if self.foreign is not None:
            self.done = True
            return b""
        if self._left:
            return self._ask(self._left.popleft(), self._wait, now)
        if not self._listened:
            self._listened = True
            self._until = now + LATE
            return b""
        address = self._doubts.next()
        if address is None or max(self._silent, len(self.damaged)) >= MOST_SILENT:
            self.counted.noisy = address is not None
            self.done = True
            return b""
        self._doubts.asked.add(address)
        return self._ask(address, LATE, now, alone=True)

    def _ask(self, address: int, wait: float, now: float, *, alone: bool = False) -> bytes:
        frame = self._protocol.prober.probe(address).numbered(1 if alone else 0)
        raw: bytes = frame.encode()
        until = now + len(raw) * self._timing.character
        self._slot = _Asked(address, frame, until, wait, alone)
        while self._asked and self._asked[0].until < now - LATE:
            self._asked.popleft()
        self._asked.append(self._slot)
        self._until = until + wait
        return raw

    # -- hearing ---------------------------------------------------------------------------

    def _take(self, events: Iterable[FrameReceived[Any] | Damaged], now: float) -> None:
        for event in events:
            if isinstance(event, Damaged):
                self._take_damage(event)
            else:
                self._take_frame(event, now)

    def _take_frame(self, event: FrameReceived[Any], now: float) -> None:
        frame = event.frame
        for asked in reversed(self._asked):
            if frame == asked.frame:
                self.counted.echoes += 1
                return
            if frame.answers(asked.frame):
                self._answered(asked, event, now)
                return
        if self._protocol.from_master(frame) and not self._anyway:
            self.foreign = self._protocol.describe(frame)
            self._until = now
        else:
            self.counted.strays += 1

    def _answered(self, asked: _Asked, event: FrameReceived[Any], now: float) -> None:
        asked.answers += 1
        address = asked.address
        late = asked is not self._slot
        if address not in self.found or (asked.alone and asked.answers == 1):
            took = now - len(event.raw) * self._timing.character - asked.until
            said = self._protocol.describe(event.frame)
            self.found[address] = Found(max(0.0, round(took * 1000, 1)), said)
            if late:
                self._doubts.late.append(address)
        if asked.alone:  # it has been heard: a second one would follow soon
            self._until = min(self._until, now + self._wait)

    def _take_damage(self, event: Damaged) -> None:
        self.counted.damaged += 1
        if self._slot is not None:
            self._slot.damage += event.raw
        else:
            self._doubts.groups.append(self._unanswered())

    def _judge(self) -> None:
        """The time of a probe is over: what became of it?"""
        slot, self._slot = self._slot, None
        if slot is None:
            return
        if slot.alone:
            self._judge_alone(slot)
        elif slot.answers > 1 or (slot.answers and slot.damage):
            self._doubts.groups.append([slot.address])
        elif slot.damage:
            self._doubts.groups.append(self._unanswered())

    def _unanswered(self) -> list[int]:
        """Who may have sent the bytes that came last, the likeliest first."""
        return [
            asked.address
            for asked in reversed(self._asked)
            if asked.until >= self._last_heard - LATE and asked.address not in self.found
        ]

    def _judge_alone(self, slot: _Asked) -> None:
        address = slot.address
        found = self.found.get(address)
        if slot.answers or slot.damage:
            self._doubts.heard.add(address)
        else:
            self._silent += 1
        if found is None:
            if slot.damage:
                self.damaged[address] = slot.damage
        elif slot.answers > 1 or slot.damage:
            self.found[address] = replace(found, doubt=TWICE)
        elif not slot.answers:
            self.found[address] = replace(found, doubt=ONCE)
