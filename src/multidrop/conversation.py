"""What a master says, step by step, without a line and without a clock.

A conversation is a generator of steps. It composes with `yield from`; whoever
runs it (a blocking line, an asyncio line, a script in a test) sends the answer
of each `Ask` back in, or throws `NoReply` where none came. A conversation keeps
the line from its first to its last step.
"""

from __future__ import annotations

from collections.abc import Generator, Hashable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar


class Frame(Protocol):
    """What a line needs to know of a frame of any protocol."""

    NUMBERS: ClassVar[int]  # how many sequence numbers the protocol has; 1: none

    @property
    def address(self) -> int: ...
    @property
    def about(self) -> Hashable:
        """What a question and its answer have in common, numbers apart."""
        ...

    def encode(self) -> bytes: ...
    def numbered(self, number: int) -> Self:
        """The same frame for another attempt; itself where the protocol does not number."""
        ...

    def answers(self, question: Self) -> bool:
        """Whether this is the answer to `question`: only then may a master believe it."""
        ...


FrameT = TypeVar("FrameT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True, slots=True)
class Ask(Generic[FrameT]):
    """Send a frame and wait for the one that answers it."""

    frame: FrameT
    repeatable: bool = False  # reads say True; asking twice may act twice
    attempts: int | None = None  # of what is repeatable, at most; None: as the line is set
    rests: bool = False
    """Before another attempt, until a late answer to the one before can no longer pass for its own.

    For what is repeatable and no read: an echo must vouch for the attempt that it answers.
    """


@dataclass(frozen=True, slots=True)
class Learn(Ask[FrameT]):
    """Ask a read, unless the line can already tell an echo from an answer that equals its request.

    Such a request may only be asked after this. The answer that comes back is
    None where nothing had to be sent.
    """

    repeatable: bool = True


@dataclass(slots=True)
class Delay:
    """How long after the last byte heard a frame was written, s; None until that is known."""

    seconds: float | None = None


@dataclass(frozen=True, slots=True)
class Tell(Generic[FrameT]):
    """Send a frame that nobody answers: a broadcast, an acknowledge."""

    frame: FrameT
    within: float | None = None  # s after the last byte received; later it is not sent: TooLate
    delay: Delay = field(default_factory=Delay, compare=False)  # of what has a `within`


@dataclass(frozen=True, slots=True)
class Wait:
    """Keep the line's turn and let time pass, counted from the end of what was sent."""

    seconds: float


class TooLate(Exception):
    """Thrown into a conversation whose `Tell(within=...)` was not sent because time was up."""


Conversation = Generator["Ask[FrameT] | Tell[FrameT] | Wait", FrameT, ResultT]


def once(conversation: Conversation[FrameT, ResultT]) -> Conversation[FrameT, ResultT]:
    """The same conversation with one attempt for each question: silence costs one time-out."""
    answer: Any = None
    error: Exception | None = None
    try:
        while True:
            step = conversation.send(answer) if error is None else conversation.throw(error)
            if isinstance(step, Ask):
                step = type(step)(step.frame, step.repeatable, 1, step.rests)
            answer, error = None, None
            try:
                answer = yield step
            except Exception as raised:
                error = raised
    except StopIteration as stop:
        result: ResultT = stop.value
        return result
    finally:
        conversation.close()
