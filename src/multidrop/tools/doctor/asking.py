"""Reads that a doctor asks: first every address quickly, then those that are there again and again.

No clock in here: whoever runs it passes `now`, as with an `Exchange`. Nothing that was
heard is thrown away.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from multidrop.device import ProtocolModule
from multidrop.events import Damaged
from multidrop.exchange import LATE
from multidrop.probing import next_probe_at
from multidrop.timing import LineSettings
from multidrop.tools.doctor.evidence import GLITCH, Asked, Piece

FEW = 4
"""So many addresses are asked thoroughly at once, without a quick pass."""
QUICK = 0.08
"""s for the first byte of an answer in the quick pass; later ones count too."""
TIMES = 20
"""How often each device is asked."""
MOST_SILENT = 2
"""Reads without an answer, from the first one on, after which a device is not there."""
MOST_LOST = 8
"""Reads without an answer, after which enough is known of a device."""
LINGER = 0.060
"""s after an answer: a second device with the same address may answer a little later."""
RESTED = 0.7
"""s after bytes that are no answer: what is missing may come behind a gap."""
LONGER = 1.0
"""s beyond a master's patience for which a late answer is waited for."""


@dataclass(slots=True)
class _Slot:
    """The read that is out."""

    frame: Any
    raw: bytes
    start: float
    end: float
    alone: bool
    pieces: list[Piece] = field(default_factory=list)
    answered: bool = False
    unread: int = 0  # bytes heard that were no whole frame so far


class Asking:
    """Asks `addresses`. `asked` is what came of it, `foreign` another master's request."""

    def __init__(
        self,
        protocol: ProtocolModule,
        settings: LineSettings,
        addresses: Sequence[int],
        *,
        network: bool,
        times: int = TIMES,
    ) -> None:
        self._protocol = protocol
        self._timing = settings.timing(network=network)
        self._new_decoder = settings.decoder
        self._decoder = settings.decoder()
        self._quick = deque(addresses if len(addresses) > FEW else ())
        self._again = deque(() if self._quick else addresses)
        self._times = times
        self._patience = max(LATE, self._timing.answer) + LONGER
        self._slot: _Slot | None = None
        self._left = 0  # further reads of the device that is being asked
        self._silent = 0
        self._there = False  # the device that is being asked has answered
        self._listened = not self._quick
        self._until = 0.0
        self._last_heard = float("-inf")
        self.asked: list[Asked] = []
        self.answers = 0
        self.foreign: Any = None
        self.done = False

    @property
    def where(self) -> str:
        """What is being asked now, for a person."""
        if self._slot is None:
            return "listening for late answers"
        address = self._slot.frame.address
        return f"asking {address}" + (f", {self._left} times more" if self._left else "")

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
            slot = self._slot
            if slot is not None:
                slot.pieces.append(Piece(data, now, damaged))
                slot.unread += len(data)
            self._take(self._decoder.receive_data(data), now)
            if slot is not None and slot.alone and not slot.answered and slot.unread > GLITCH:
                self._until = min(now + RESTED, slot.end + self._patience)
        if self.done or now < self.deadline:
            return b""
        self._take(self._decoder.silence(), now)
        self._end_slot()
        return self._next(now)

    # -- asking ----------------------------------------------------------------------------

    def _next(self, now: float) -> bytes:
        if self.foreign is not None:
            self.done = True
            return b""
        if self._quick:
            return self._ask(self._quick.popleft(), QUICK, now, alone=False)
        if not self._listened:
            return self._listen(now)
        if self._slot is not None and self._left:
            self._left -= 1
            return self._ask(self._slot.frame.address, self._patience, now, alone=True)
        self._slot = None
        if not self._again:
            self.done = True
            return b""
        self._left, self._silent, self._there = self._times - 1, 0, False
        return self._ask(self._again.popleft(), self._patience, now, alone=True)

    def _listen(self, now: float) -> bytes:
        """The end of the quick pass: late answers belong to its last read."""
        self._listened = True
        if self._slot is not None:
            self._slot.answered = False
        self._until = now + LATE
        return b""

    def _ask(self, address: int, wait: float, now: float, *, alone: bool) -> bytes:
        frame = self._protocol.prober.probe(address).numbered(len(self.asked))
        raw: bytes = frame.encode()
        end = now + len(raw) * self._timing.character
        self._slot = _Slot(frame, raw, now, end, alone)
        self._until = end + wait
        return raw

    def _end_slot(self) -> None:
        """Keep what came of the read, and decide who is asked again."""
        slot = self._slot
        if slot is None:
            return
        done = Asked(slot.frame, slot.raw, slot.start, slot.end, tuple(slot.pieces), slot.alone)
        if self._listened and not slot.alone and self.asked and self.asked[-1].frame == slot.frame:
            self.asked[-1] = done  # it went on listening
        else:
            self.asked.append(done)
        if slot.alone:
            self._there |= slot.answered
            self._silent += not slot.answered
            if self._silent >= (MOST_LOST if self._there or slot.unread > GLITCH else MOST_SILENT):
                self._left = 0
        elif self._listened:
            self._again.extend(self._present())
            self._slot = None

    def _present(self) -> list[int]:
        """Who answered in the quick pass, or may have sent bytes that are no frame."""
        present: set[int] = set()
        for item in self.asked:
            decoder = self._new_decoder()
            data = b"".join(piece.data for piece in item.pieces)
            broken = 0
            for event in (*decoder.receive_data(data), *decoder.silence()):
                if isinstance(event, Damaged):
                    broken += len(event.raw)
                elif not self._protocol.from_master(event.frame):
                    present.add(event.frame.address)
            if broken > GLITCH:
                present.add(item.frame.address)
        return sorted(present & {item.frame.address for item in self.asked})

    # -- hearing ---------------------------------------------------------------------------

    def _take(self, events: Sequence[Any], now: float) -> None:
        slot = self._slot
        for event in events:
            if isinstance(event, Damaged):
                continue
            if slot is not None:
                slot.unread -= len(event.raw)
            if slot is not None and event.frame == slot.frame:
                continue  # our own echo
            if slot is not None and event.frame.answers(slot.frame):
                slot.answered = True
                self.answers += 1
                self._until = min(self._until, now + (LINGER if slot.alone else 0.0))
            elif self._protocol.from_master(event.frame):
                self.foreign = event.frame
                self._until = now
