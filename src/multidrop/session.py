"""What a line remembers from one exchange to the next: its counters, its echo, who may answer late."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

from multidrop import conversation as steps
from multidrop.decoder import Decoder
from multidrop.events import Damaged, FrameReceived
from multidrop.timing import Timing
from multidrop.unanswered import Unanswered

FrameT = TypeVar("FrameT", bound=steps.Frame)


@dataclass(slots=True)
class Counters:
    """What happened on a line since it was opened."""

    requests: int = 0
    answers: int = 0
    no_reply: int = 0
    damaged: int = 0
    foreign: int = 0  # valid frames that nobody here had asked for
    echoes: int = 0

    # Written out, for a line service does both for every poll.

    def copy(self) -> Counters:
        return Counters(
            self.requests, self.answers, self.no_reply, self.damaged, self.foreign, self.echoes
        )

    def count_since(self, before: Counters, now: Counters) -> None:
        """Count what was counted in `now` since `before`, a copy of it."""
        self.requests += now.requests - before.requests
        self.answers += now.answers - before.answers
        self.no_reply += now.no_reply - before.no_reply
        self.damaged += now.damaged - before.damaged
        self.foreign += now.foreign - before.foreign
        self.echoes += now.echoes - before.echoes


@dataclass(slots=True)
class Delays:
    """How long after the last byte heard what had to be in time was written, in s.

    A Datalink Acknowledge after its echo is such a thing.
    """

    number: int = 0
    last: float = 0.0
    longest: float = 0.0

    def count(self, seconds: float) -> None:
        self.number += 1
        self.last = seconds
        self.longest = max(self.longest, seconds)


@dataclass(slots=True)
class Numbers:
    """Sequence numbers of one address: each attempt the next one, those given up on rest."""

    count: int
    last: int = -1
    resting: dict[int, float] = field(default_factory=dict)  # number -> free again at

    def free_at(self, now: float) -> float:
        """When the next number may be used."""
        self.resting = {number: at for number, at in self.resting.items() if at > now}
        return min(self.resting.values()) if len(self.resting) >= self.count else now

    def take(self) -> int:
        number = (self.last + 1) % self.count
        while number in self.resting:
            number = (number + 1) % self.count
        self.last = number
        return number


class Session(Generic[FrameT]):
    """What a line remembers from one exchange to the next.

    `echo` is True on a line that hears itself, False on one that does not, and
    None until that is known. `keeps_time` is whether bytes come no sooner than
    the baud rate lets a request leave, as they do not on a simulated line, or
    behind a network at another baud rate; None until the first frame.
    """

    def __init__(
        self, decoder: Decoder[FrameT], timing: Timing, *, echo: bool | None = None
    ) -> None:
        self.decoder = decoder
        self.timing = timing
        self.echo = echo
        self.keeps_time: bool | None = None
        self.counters = Counters()
        self.delays = Delays()
        self.quiet_from = 0.0  # the next request may start then
        self.last_heard = 0.0  # when the last byte came
        self.last_sent: FrameT | None = None
        self.sent_until = 0.0  # the calculated end of the last request on the wire
        self.unanswered: Unanswered[FrameT] = Unanswered()
        self.longest_answer = timing.longest_frame * timing.character + 2 * timing.silence
        self._numbers: dict[int, Numbers] = {}

    def hear(
        self, data: bytes, now: float, *, damaged: bool = False
    ) -> list[FrameReceived[FrameT] | Damaged]:
        """Decode what came at `now`; `damaged` bytes carry the port's mark of a parity error."""
        self.last_heard = now
        self.quiet_from = now + self.timing.gap
        return self.decoder.line_error(data) if damaged else self.decoder.receive_data(data)

    def drain(self, data: bytes, now: float, *, damaged: bool = False) -> None:
        """Count what came while nobody was asking; none of it will be believed."""
        if data:
            self.count_strays(self.hear(data, now, damaged=damaged))
        if self.decoder.pending and now - self.last_heard >= self.timing.silence:
            self.count_strays(self.decoder.silence())

    def count_strays(self, events: list[FrameReceived[FrameT] | Damaged]) -> None:
        for event in events:
            if isinstance(event, Damaged):
                self.counters.damaged += 1
            elif self.echo is not False and event.frame == self.last_sent:
                self.counters.echoes += 1
                self.last_sent = None
            else:
                self.counters.foreign += 1

    @property
    def tells_echo(self) -> bool:
        """Whether an echo can be told from an answer that equals its request."""
        return self.echo is True or (self.echo is False and self.keeps_time is not None)

    def numbers(self, frame: FrameT) -> Numbers:
        found = self._numbers.get(frame.address)
        if found is None:
            found = self._numbers[frame.address] = Numbers(frame.NUMBERS)
        return found
