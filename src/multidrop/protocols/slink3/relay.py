"""SLINK3 on a line that many masters share.

The sequence numbers on the wire are the line's own; each master gets its answer
with the CONTROL that it asked with. A slave keeps a note of the last broadcast
until its next command (A chapter 9), so a broadcast holds the line while its
master asks who received it.
"""

from __future__ import annotations

from multidrop.conversation import Ask, Conversation, Tell
from multidrop.protocols.slink3.frame import ANSWER, Frame
from multidrop.protocols.slink3.messages import Command, Response
from multidrop.relay import Passage
from multidrop.writing import Outcome

HARMLESS = frozenset(
    {
        Command.READ_TYPED_PARAMETER,
        Command.READ_STANDARD_PARAMETER,
        Command.STATUS_WORD,
        Command.MALFUNCTION_CODE,
        Command.BROADCAST_COMMAND_VERIFY,
    }
)
"""The commands of the documents that change nothing. What a user defined one does, nobody can say."""

LAST_SLAVE = 127
"""Nobody answers above: a broadcast address is there, 255 or 128."""

BROADCAST_HOLD = 1.0
"""s in which the master of a broadcast may ask every slave whether it received it."""


class Slink3Relay:
    def shows(self, frame: Frame) -> bool:
        return not frame.is_answer

    def passage(self, frame: Frame, held: Frame | None) -> Passage[Frame] | str:
        if frame.is_answer:
            return "an answer, and no request"
        if frame.address > LAST_SLAVE:
            return Passage(acts=True, answered=False, hold=BROADCAST_HOLD, written=frame)
        if frame.code not in HARMLESS:
            return Passage(acts=True, refusal=_refusal(frame), written=frame)
        if frame.code == Command.BROADCAST_COMMAND_VERIFY:
            return Passage(hold=None)
        return Passage()

    def carry(self, frame: Frame, held: Frame | None) -> Conversation[Frame, Frame | None]:
        if frame.address > LAST_SLAVE:
            yield Tell(frame)
            return None
        answer = yield Ask(frame, repeatable=frame.code in HARMLESS)
        return Frame(answer.address, frame.control, answer.order, answer.code, answer.data)

    def let_go(self, held: Frame) -> Conversation[Frame, None]:
        """Nothing needs to be said."""
        return
        yield

    def outcome(self, answer: Frame | None) -> Outcome:
        if answer is None or answer.code in (Response.OK, Response.OK_BROADCAST):
            return Outcome.UNVERIFIED
        submitted = answer.code == Response.COMMAND_SUBMITTED
        return Outcome.UNKNOWN if submitted else Outcome.NOT_APPLIED


def _refusal(frame: Frame) -> Frame:
    order = frame.order & 0x0E | ANSWER  # with the destination ID of the request
    return Frame(frame.address, frame.control, order, Response.WRITE_NOT_ALLOWED)
