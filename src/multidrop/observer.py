"""From the bytes that pass on a line to transactions, for somebody who asks nothing.

No clock in here: `now` is an argument, in seconds of any clock. Nothing that is
heard raises, and every frame and every damaged byte comes out once::

    for found in observer.receive_data(data, now):
        ...  # a Transaction, a Stray or a Damage
    # and at observer.deadline, if that comes first: observer.time_passed(now)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.exchange import LATE
from multidrop.profile import Profile
from multidrop.timing import LineSettings
from multidrop.transaction import Damage, Heard, Stray, Transaction

Found = Transaction | Stray | Damage

_new = tuple.__new__  # what a named tuple's own constructor calls, and faster
_NEVER = float("inf")


class Observer:
    """Follows one line. `profiles` are of the devices that are known, by address.

    `network` is for bytes that come over one: they may pause for longer.
    Raises `UsageError` for a profile that is not of this protocol, or that says
    what its protocol cannot.
    """

    def __init__(
        self,
        protocol: ProtocolModule,
        settings: LineSettings,
        profiles: Mapping[int, Profile],
        *,
        network: bool = False,
    ) -> None:
        self._protocol = protocol
        self._settings = settings
        self._timing = settings.timing(network=network)
        self._profiles = dict(profiles)
        self._unknown = Profile(name=protocol.name, protocol=protocol.name)
        for address, profile in self._profiles.items():
            _check(protocol, address, profile)
        self._decoder = settings.decoder()
        self._clock = _Clock(self._timing.character)
        self._last_heard = 0.0
        self._open: tuple[Heard, ...] = ()
        self._meant: Any = None  # what the open frames mean, where that was worked out
        self._answer: Heard | None = None
        self._echo: Heard | None = None
        self._hears_itself = False
        self.echoes = 0

    # -- what passes -----------------------------------------------------------------------

    def receive_data(
        self, data: bytes, now: float, *, sent: bool | None = None, damaged: bool = False
    ) -> list[Found]:
        """Take bytes from the line; returns what they complete.

        `now` is when the last byte came; of bytes that this side sent, when the
        first one left, as a tap of a line has it. `damaged` bytes carry the
        port's mark of a parity or framing error.
        """
        if sent:
            return self._receive_sent(data, now)
        found = self.time_passed(now)
        self._last_heard = now
        self._clock.receive(len(data), now)
        decoder = self._decoder
        events = decoder.line_error(data) if damaged else decoder.receive_data(data)
        return found + self._received(events, sent) if events else found

    def frame(
        self, event: FrameReceived[Any] | Damaged, now: float, sent: bool | None = None
    ) -> list[Found]:
        """Take a frame, or damage, that somebody cut already; `now` is when its last byte came."""
        if type(event) is Damaged:
            return [_new(Damage, (event.raw, event.reason, now, sent))]
        frame, raw = event
        start = now - len(raw) * self._timing.character
        return self._hear(_new(Heard, (frame, raw, start, now, sent)))

    @property
    def deadline(self) -> float:
        """When `time_passed` wants to be called even if nothing comes; infinite if never."""
        open_until = self._open[-1].end + LATE if self._open else _NEVER
        if self._decoder.pending:
            return min(open_until, self._last_heard + self._timing.silence)
        return open_until

    def time_passed(self, now: float) -> list[Found]:
        """Nothing came until `now`: a frame may have been cut short, a question not answered."""
        found: list[Found] = []
        if self._decoder.pending and now >= self._last_heard + self._timing.silence:
            found = self._cut_short(None)
        if self._open and now >= self._open[-1].end + LATE:
            found += self._close()
        return found

    def finish(self) -> list[Found]:
        """Nothing more will come: what is still open comes out."""
        return self._cut_short(None) + self._close()

    # -- bytes to frames -------------------------------------------------------------------

    def _receive_sent(self, data: bytes, now: float) -> list[Found]:
        """What this side sends is whole, and ends a frame that was still coming."""
        found = self.time_passed(now) + self._cut_short(False)
        decoder = self._settings.decoder()
        for event in [*decoder.receive_data(data), *decoder.silence()]:
            now += len(event.raw) * self._timing.character
            found += self.frame(event, now, True)
        return found

    def _cut_short(self, sent: bool | None) -> list[Found]:
        found = self._received(self._decoder.silence(), sent)
        self._clock = _Clock(self._timing.character)  # a decoder may skip a byte without a word
        return found

    def _received(
        self, events: Iterable[FrameReceived[Any] | Damaged], sent: bool | None
    ) -> list[Found]:
        found: list[Found] = []
        for event in events:
            found += self.frame(event, self._clock.end_of(len(event.raw)), sent)
        return found

    # -- frames to transactions ------------------------------------------------------------

    def _hear(self, heard: Heard) -> list[Found]:
        frame, _, start, _, sent = heard
        continues = self._protocol.continues
        open_frames = self._open
        found: list[Found] = []
        if open_frames:
            last = open_frames[-1]
            if start >= last.end + LATE:
                found = self._close()
            elif self._is_echo(heard):
                self.echoes += 1
                self._echo = heard
                return []
            elif (sent is None or sent is not last.sent) and continues(
                [known.frame for known in open_frames], frame
            ):
                return self._continue(heard)
        if continues((), frame):
            found += self._close()
            self._open = (heard,)
            return found
        found.append(Stray(heard, self._protocol.describe(frame)))
        return found

    def _continue(self, heard: Heard) -> list[Found]:
        frames = self._open = (*self._open, heard)
        if self._answer is None and heard.frame.answers(frames[0].frame):
            self._answer = heard
        self._meant = self._explain(frames)
        return self._close() if self._meant.complete else []

    def _explain(self, frames: tuple[Heard, ...]) -> Any:
        profile = self._profiles.get(frames[0].frame.address, self._unknown)
        return self._protocol.explain([heard.frame for heard in frames], profile)

    def _close(self) -> list[Found]:
        """What is open, as it is; nothing will be added to it."""
        frames = self._open
        if not frames:
            return []
        question, answer, echo, meant = frames[0], self._answer, self._echo, self._meant
        self._open = ()
        self._answer = self._echo = self._meant = None
        asked = question.frame
        if len(frames) == 1:
            if not question.sent and not self._protocol.from_master(asked):
                return [Stray(question, self._protocol.describe(asked))]
            meant = self._explain(frames)
        ms = None if answer is None else max(0.0, answer.start - question.end) * 1000
        return [_new(Transaction, (frames, meant, asked.address, ms, echo))]

    def _is_echo(self, heard: Heard) -> bool:
        """Whether this is the copy of the question that a line which hears itself delivers.

        Where the right answer equals its question, only a copy that began before
        the question was over is certain to be none, or one on a line that was
        heard to echo before.
        """
        question = self._open[0]
        if len(self._open) > 1 or self._echo is not None or heard.frame != question.frame:
            return False
        if heard.sent or (heard.sent is False and not question.sent):
            return False
        overlaps = heard.start < question.end - self._timing.character / 2
        if not question.sent:
            return overlaps and not heard.frame.answers(question.frame)
        if heard.frame.answers(question.frame):
            return overlaps or self._hears_itself
        self._hears_itself = True
        return True


class _Clock:
    """When the last byte of each event came, from when the pieces came that hold them."""

    def __init__(self, character: float) -> None:
        self._character = character
        self._pieces: deque[tuple[int, float]] = deque()  # bytes so far with this piece, its time
        self._received = 0
        self._read = 0

    def receive(self, size: int, now: float) -> None:
        self._received += size
        self._pieces.append((self._received, now))

    def end_of(self, size: int) -> float:
        """When the next `size` bytes were over: those behind them in their piece came later."""
        self._read += size
        pieces = self._pieces
        while pieces[0][0] < self._read:
            pieces.popleft()
        until, now = pieces[0]
        return now - (until - self._read) * self._character


def _check(protocol: ProtocolModule, address: int, profile: Profile) -> None:
    if profile.protocol != protocol.name:
        raise UsageError(
            f"device {address}: profile {profile.name} is of {profile.protocol}, the line {protocol.name}"
        )
    device = protocol.device(address, profile, {})
    for name in profile.points:
        device.points(name)


__all__ = ["Found", "Observer"]
