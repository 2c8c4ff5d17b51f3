"""A protocol for tests of the ground: a frame is a word in brackets, answered in capitals.

A `[` claims that more follows, as a false start with a long LENGTH does. Digits
are answered as they are, as in protocols whose right answer equals the request.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from multidrop.conversation import Ask, Conversation, Tell
from multidrop.decoder import Decoder
from multidrop.session import Session
from multidrop.timing import Timing

TIMING = Timing(
    character=0.001, gap=0.002, answer=1.0, silence=0.050, longest_frame=255, attempts=3
)


@dataclass(frozen=True)
class Word:
    content: str
    NUMBERS: ClassVar[int] = 1

    @property
    def address(self) -> int:
        return 0

    @property
    def about(self) -> str:
        return self.content.upper()

    def encode(self) -> bytes:
        return f"({self.content})".encode()

    def numbered(self, number: int) -> Word:
        return self

    def answers(self, question: Word) -> bool:
        return self.content == question.content.upper()


def read_front(buffer: bytes, at: int) -> tuple[Word, int] | str | None:
    if buffer[at] == 0x5B:  # [
        return None
    if buffer[at] != 0x28:
        return "no start"
    end = buffer.find(b")", at)
    if end < 0:
        return None
    return Word(buffer[at + 1 : end].decode("latin-1")), end + 1 - at


def new_session(*, gap: float = TIMING.gap, echo: bool | None = None) -> Session[Word]:
    return Session(Decoder(read_front), replace(TIMING, gap=gap), echo=echo)


def ask(*words: str, repeatable: bool = True) -> Conversation[Word, str]:
    """Asks words one after the other; returns the answers, joined."""
    answers = ""
    for word in words:
        answers += (yield Ask(Word(word), repeatable)).content
    return answers


def tell(word: str) -> Conversation[Word, str]:
    yield Tell(Word(word))
    return "told"
