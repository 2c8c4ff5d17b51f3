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
from multidrop.transaction import Damage, Heard, Meaning, Stray, Transaction

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
        self._continues = protocol.continues
        self._settings = settings
        self._timing = settings.timing(network=network)
        self._character = self._timing.character
        self._profiles = dict(profiles)
        self._unknown = Profile(name=protocol.name, protocol=protocol.name)
        one_of_each = {id(profile): at for at, profile in self._profiles.items()}
        for address in one_of_each.values():
            _check(protocol, address, self._profiles[address])
        self._decoder = settings.decoder()
        self._clock = _Clock(self._character)
        self._last_heard = 0.0
        self._heard_as: bool | None = None  # `sent` of what is in the decoder
        self._open: list[Heard] = []
        self._frames: list[Any] = []  # the same as frames alone
        self._meaning: Meaning | None = None  # of what is open, where that was worked out
        self._answer: Heard | None = None
        self._echo: Heard | None = None
        self._last: Heard | None = None  # the frame before, until its echo came
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
        found = self._silence(now - len(data) * self._character)
        self._last_heard = now
        self._heard_as = sent
        self._clock.receive(len(data), now)
        decoder = self._decoder
        events = decoder.line_error(data) if damaged else decoder.receive_data(data)
        return found + self._received(events) if events else found

    def frame(
        self, event: FrameReceived[Any] | Damaged, now: float, sent: bool | None = None
    ) -> list[Found]:
        """Take a frame, or damage, that somebody cut already; `now` is when its last byte came."""
        if type(event) is Damaged:
            return [_new(Damage, (event.raw, event.reason, now, sent))]
        frame, raw = event
        start = now - len(raw) * self._character
        heard = _new(Heard, (frame, raw, start, now, sent))
        last = self._last
        if last is not None and frame == last.frame and self._is_echo(heard, last):
            self._take_echo(heard)
            return []
        self._last = heard
        found: list[Found] = []
        if self._open:
            before = self._open[-1]
            if start >= before.end + LATE:
                found = self._close()
            elif (sent is None or sent is not before.sent) and self._continues(self._frames, frame):
                return self._continue(heard)
        if not self._continues((), frame):
            found.append(Stray(heard, self._protocol.describe(frame)))
            return found
        if self._open:
            found = self._close()
        self._open.append(heard)
        self._frames.append(frame)
        return found

    @property
    def deadline(self) -> float:
        """When `time_passed` wants to be called even if nothing comes; infinite if never."""
        cut_short = self._last_heard + self._timing.silence if self._decoder.pending else _NEVER
        if not self._open or self._decoder.unfinished:  # what is still coming may be the answer
            return cut_short
        return min(cut_short, self._open[-1].end + LATE)

    def time_passed(self, now: float) -> list[Found]:
        """Nothing came until `now`: a frame may have been cut short, a question not answered."""
        found = self._silence(now)
        if self._open and not self._decoder.unfinished and now >= self._open[-1].end + LATE:
            found += self._close()
        return found

    def finish(self) -> list[Found]:
        """Nothing more will come: what is still open comes out."""
        return self._cut_short() + self._close()

    # -- bytes to frames -------------------------------------------------------------------

    def _receive_sent(self, data: bytes, now: float) -> list[Found]:
        """What this side sends is whole, and ends a frame that was still coming."""
        found = self._cut_short()
        decoder = self._settings.decoder()
        for event in [*decoder.receive_data(data), *decoder.silence()]:
            now += len(event.raw) * self._character
            found += self.frame(event, now, True)
        return found

    def _silence(self, now: float) -> list[Found]:
        if self._decoder.pending and now >= self._last_heard + self._timing.silence:
            return self._cut_short()
        return []

    def _cut_short(self) -> list[Found]:
        found = self._received(self._decoder.silence())
        self._clock = _Clock(self._character)  # a decoder may skip a byte without a word
        return found

    def _received(self, events: Iterable[FrameReceived[Any] | Damaged]) -> list[Found]:
        found: list[Found] = []
        for event in events:
            found += self.frame(event, self._clock.end_of(len(event.raw)), self._heard_as)
        return found

    # -- frames to transactions ------------------------------------------------------------

    def _continue(self, heard: Heard) -> list[Found]:
        if self._answer is None and heard.frame.answers(self._frames[0]):
            self._answer = heard
        self._open.append(heard)
        self._frames.append(heard.frame)
        self._meaning = self._explained()
        return self._close() if self._meaning.complete else []

    def _explained(self) -> Meaning:
        profile = self._profiles.get(self._frames[0].address, self._unknown)
        return self._protocol.explain(self._frames, profile)

    def _close(self) -> list[Found]:
        """What is open, as it is; nothing will be added to it."""
        frames, answer, echo = tuple(self._open), self._answer, self._echo
        if not frames:
            return []
        question = frames[0]
        found: Found
        if (
            len(frames) == 1
            and not question.sent
            and not self._protocol.from_master(question.frame)
        ):
            found = Stray(question, self._protocol.describe(question.frame))
        else:
            meaning = self._meaning or self._explained()
            ms = None if answer is None else max(0.0, answer.start - question.end) * 1000
            address = question.frame.address
            found = _new(Transaction, (frames, meaning, address, ms, echo))
        self._open, self._frames = [], []
        self._meaning = self._answer = self._echo = None
        return [found]

    # -- local echo ------------------------------------------------------------------------

    def _is_echo(self, heard: Heard, last: Heard) -> bool:
        """Whether this is the copy of the frame before, which a line that hears itself delivers.

        Where the right answer equals its question, only a copy that began before
        the question was over is certain to be none, or one on a line that was
        heard to echo before.
        """
        overlaps = heard.start < last.end - self._character / 2
        ambiguous = heard.frame.answers(last.frame)
        if not last.sent:
            return heard.sent is None and overlaps and not ambiguous
        if heard.sent or heard.start >= last.end + LATE:
            return False
        return overlaps or self._hears_itself or not ambiguous

    def _take_echo(self, heard: Heard) -> None:
        """It belongs to its question; that of an Acknowledge comes when all is over."""
        self.echoes += 1
        self._hears_itself = True
        self._last = None
        if len(self._open) == 1 and heard.frame == self._frames[0]:
            self._echo = heard


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
