"""One conversation against bytes and time: timeouts, attempts, numbering, matching.

No clock in here: whoever runs an exchange passes `now`, in seconds of any
monotonic clock. A runner is a loop of four lines::

    to_send = exchange.start(now)
    while not exchange.done:
        ... send to_send, wait for bytes until exchange.deadline ...
        to_send = exchange.advance(data, now)
    ... send what is left in to_send ...
    return exchange.result()

One that measures how late an `Acknowledge` was adds two lines behind "send"::

    if exchange.told is not None:
        exchange.written(now)
"""

from __future__ import annotations

from typing import Generic, TypeVar

from multidrop import conversation as steps
from multidrop.conversation import Ask, Conversation, Learn, Tell, TooLate, Wait
from multidrop.errors import NoReply, UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.session import Numbers, Session

FrameT = TypeVar("FrameT", bound=steps.Frame)
ResultT = TypeVar("ResultT")

LATE = 1.5
"""s: a sequence number that was given up on rests so long (SLINK3's longest answer time)."""


class Exchange(Generic[FrameT, ResultT]):
    """Carries out one conversation on one line."""

    # One is made for every read, so it begins with the values of its class.
    done = False
    acted = False  # something that is not a read went out
    asked_at = 0.0  # when the last request started
    received_at: float | None = None  # when the last answer was complete
    deadline = 0.0
    """When `advance` wants to be called even if nothing arrived."""

    told: Tell[FrameT] | None = None
    """What had to be in time and was given out: whoever writes it calls `written` then."""

    _step: Ask[FrameT] | Tell[FrameT] | Wait | None = None
    _outcome: ResultT | None = None
    _error: BaseException | None = None
    _sent: FrameT | None = None  # the attempt that waits for its answer
    _numbers: Numbers | None = None
    _echo_due = False
    _clean = True  # nothing damaged was heard in this attempt
    _answer_until = 0.0
    _not_after = 0.0  # even a line that never falls silent ends an attempt
    _attempt = 0
    _damaged: tuple[bytes, ...] = ()
    _heard: tuple[bytes, ...] = ()

    def __init__(
        self, conversation: Conversation[FrameT, ResultT], session: Session[FrameT]
    ) -> None:
        self._conversation = conversation
        self._session = session

    def start(self, now: float) -> bytes:
        """Begin; returns the bytes to send at once (none while the line must rest)."""
        return self._resume(None, None, now)

    def advance(self, data: bytes, now: float, *, damaged: bool = False) -> bytes:
        """Take bytes that arrived, or none at the deadline; returns the bytes to send at once."""
        out = b""
        if data:
            events = self._session.hear(data, now, damaged=damaged)
            if events:
                out = self._take(events, now)
            if self._sent is not None:
                self._set_deadline()
        while not self.done and now >= self.deadline:
            out += self._time_passed(now)
        return out

    @property
    def wants(self) -> int:
        """So many bytes must come before anything can come of them: an answer is not whole before.

        A runner may leave fewer with the system, if it looks at them at the `deadline` too.
        """
        return 1 if self._sent is None else self._session.decoder.missing

    def written(self, now: float) -> None:
        """What `told` names has been written: its delay is known only now."""
        assert self.told is not None
        session = self._session
        delay = self.told.delay.seconds = now - session.last_heard
        session.delays.count(delay)
        self.told = None

    def result(self) -> ResultT:
        """What the conversation returned; raises what it raised."""
        if self._error is not None:
            raise self._error
        return self._outcome  # type: ignore[return-value]

    def abandon(self, now: float) -> None:
        """Whoever waited has gone: a late answer to what is on its way must not be believed later."""
        if self._sent is not None:
            self._give_up(now)
        self._conversation.close()
        self.done = True

    # -- the conversation ----------------------------------------------------------------

    def _resume(self, answer: FrameT | None, error: Exception | None, now: float) -> bytes:
        self._sent = None
        try:
            if error is not None:
                step = self._conversation.throw(error)
            else:
                step = self._conversation.send(answer)  # type: ignore[arg-type]
            while type(step) is Learn and self._session.tells_echo:
                step = self._conversation.send(None)  # type: ignore[arg-type]
        except StopIteration as stop:
            self._outcome = stop.value
            self.done = True
            return b""
        except Exception as raised:
            self._error = raised
            self.done = True
            return b""
        self._step = step
        if isinstance(step, Wait):  # counted from the end of what was just sent
            self.deadline = max(now, self._session.sent_until) + step.seconds
            return b""
        self._attempt = 0
        self._damaged = self._heard = ()
        self._not_after = now + self._session.timing.answer
        return self._send_when_quiet(now)

    # -- sending -------------------------------------------------------------------------

    def _send_when_quiet(self, now: float) -> bytes:
        """Send the step's frame, or set the deadline to when the line has rested."""
        session, step = self._session, self._step
        assert step is not None
        assert not isinstance(step, Wait)
        ready = session.quiet_from
        if session.decoder.unfinished:  # somebody's frame is still coming: do not speak over it
            ready = session.last_heard + session.timing.silence
        rested = ready
        if isinstance(step, Ask):
            numbers = self._numbers = session.numbers(step.frame)
            if numbers.resting:
                ready = max(ready, numbers.free_at(now))
            if session.unanswered.known and (step.rests or not self._attempt):
                ready = max(ready, session.unanswered.clear_from(step.frame, now))
        if now < ready:
            if ready == rested and now > self._not_after:
                return self._fail("the line never fell silent", now)
            if ready > rested:
                self._not_after = ready + session.timing.answer
            self.deadline = ready
            return b""
        return self._ask(step, now) if isinstance(step, Ask) else self._tell(step, now)

    def _ask(self, step: Ask[FrameT], now: float) -> bytes:
        session = self._session
        if session.decoder.pending:
            session.count_strays(session.decoder.silence())
        assert self._numbers is not None
        if session.echo is None and _mirrored(step.frame):
            return self._resume(None, _echo_unknown(), now)
        self._attempt += 1
        self._clean = True
        self._sent = session.last_sent = step.frame.numbered(self._numbers.take())
        self._echo_due = session.echo is not False or type(step) is Learn
        raw = self._sent.encode()
        session.counters.requests += 1
        if not step.repeatable:
            self.acted = True
            session.unanswered.acted(step.frame.address)
        self.asked_at = now
        session.sent_until = now + len(raw) * session.timing.character
        self._limits_from(session.sent_until)
        return raw

    def _limits_from(self, end_of_request: float) -> None:
        session = self._session
        self.deadline = self._answer_until = end_of_request + session.timing.answer
        self._not_after = self._answer_until + session.longest_answer

    def _tell(self, step: Tell[FrameT], now: float) -> bytes:
        session = self._session
        if step.within is not None and now > session.last_heard + step.within:
            return self._resume(None, TooLate(), now)
        raw = step.frame.encode()
        session.counters.requests += 1
        session.last_sent = step.frame
        self.acted = True
        session.unanswered.acted(None)  # it may be a broadcast
        self.asked_at = now
        session.sent_until = now + len(raw) * session.timing.character
        session.quiet_from = session.sent_until + session.timing.gap
        if step.within is not None:
            self.told = step
        return raw + self._resume(None, None, now)

    # -- receiving -----------------------------------------------------------------------

    def _take(self, events: list[FrameReceived[FrameT] | Damaged], now: float) -> bytes:
        session = self._session
        for at, event in enumerate(events):
            if self._sent is None:
                session.count_strays([event])
            elif isinstance(event, Damaged):
                session.counters.damaged += 1
                self._damaged += (event.raw,)
                self._clean = False
            elif event.frame == self._sent and self._is_echo(event.frame, now):
                session.counters.echoes += 1
            elif event.frame.answers(self._sent):
                # what came behind it came before the next request: it cannot answer that
                session.count_strays(events[at + 1 :])
                return self._answered(event.frame, now)
            else:
                session.counters.foreign += 1
                self._heard += (event.raw,)
        return b""

    def _is_echo(self, copy: FrameT, now: float) -> bool:
        """Whether a copy of the request is its echo: the first one, or one that came before it left."""
        session = self._session
        if not self._echo_due:
            early = now < session.sent_until and session.keeps_time is not False
            return early and _mirrored(copy)
        self._echo_due = False
        session.echo = True
        self._notice_time(now)
        self._limits_from(now)
        return True

    def _answered(self, answer: FrameT, now: float) -> bytes:
        session = self._session
        session.counters.answers += 1
        # later attempts may get a late answer
        if session.keeps_time is not False and self._attempt == 1:
            assert self._sent is not None
            if not _mirrored(self._sent):
                self._notice_time(now)
        if type(self._step) is Learn and session.echo is None:
            if not self._clean:
                return self._again("damage hides whether the line has local echo", now)
            session.echo = False
        self.received_at = now
        if session.unanswered.known:
            session.unanswered.answered(answer)
        return self._resume(answer, None, now)

    def _notice_time(self, now: float) -> None:
        """One early answer shows that this line is faster than its baud rate, however late others were."""
        session = self._session
        if now < session.sent_until:
            session.keeps_time = False
        elif session.keeps_time is None:
            session.keeps_time = True

    def _set_deadline(self) -> None:
        session = self._session
        if session.decoder.unfinished:
            self.deadline = min(session.last_heard + session.timing.silence, self._not_after)
        else:
            self.deadline = self._answer_until

    # -- time ----------------------------------------------------------------------------

    def _time_passed(self, now: float) -> bytes:
        """The deadline is over: a wait, a rest, a frame cut short, or an answer that did not come."""
        session = self._session
        if isinstance(self._step, Wait):
            if session.decoder.pending:
                session.count_strays(session.decoder.silence())
            return self._resume(None, None, now)
        if self._sent is None:
            return self._send_when_quiet(now)
        out = b""
        if session.decoder.pending:
            out = self._take(session.decoder.silence(), now)
            if self._sent is None:
                return out
            if now < self._answer_until:
                self._set_deadline()
                return out
        self._give_up(now)
        session.counters.no_reply += 1
        return out + self._again("no reply", now)

    def _again(self, because: str, now: float) -> bytes:
        """Another attempt where one is left, else the end of the step."""
        timing = self._session.timing
        assert isinstance(self._step, Ask)
        if self._step.repeatable and self._attempt < (self._step.attempts or timing.attempts):
            self._sent = None
            self._not_after = now + timing.answer
            return self._send_when_quiet(now)
        return self._fail(because, now)

    def _give_up(self, now: float) -> None:
        assert self._numbers is not None
        if self._numbers.count > 1:
            self._numbers.resting[self._numbers.last] = now + LATE
        else:
            assert self._sent is not None
            assert isinstance(self._step, Ask)
            as_good = not (self._step.rests or self.acted)
            self._session.unanswered.give_up(self._sent, now, as_good=as_good)

    def _fail(self, because: str, now: float) -> bytes:
        failure = NoReply(self._attempt, self._damaged, self._heard, because=because)
        return self._resume(None, failure, now)


def _mirrored(question: steps.Frame) -> bool:
    """Whether the right answer to it may equal it."""
    return question.answers(question)


def _echo_unknown() -> UsageError:
    return UsageError(
        "the right answer equals this request, and whether the line has local echo is not known: "
        "begin with a Learn step, or say echo=on or echo=off; nothing was sent"
    )
