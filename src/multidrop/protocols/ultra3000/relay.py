"""Ultra3000 host commands on a line that many masters share.

The right answer to a write may be the request over again, so before the first of
them the line finds out whether it hears itself.
"""

from __future__ import annotations

from multidrop.conversation import Ask, Conversation, Tell
from multidrop.protocols.ultra3000.frame import READS, Frame
from multidrop.protocols.ultra3000.master import Master
from multidrop.protocols.ultra3000.messages import BROADCAST, LAST_ADDRESS
from multidrop.relay import Passage
from multidrop.writing import Outcome


class Ultra3000Relay:
    def __init__(self, broadcast: int = BROADCAST) -> None:
        self._broadcast = broadcast

    def shows(self, frame: Frame) -> bool:
        return not frame.is_refusal

    def passage(self, frame: Frame, held: Frame | None) -> Passage[Frame] | str:
        if frame.is_refusal:
            return "an answer, and no request"
        answered = self._is_answered(frame)
        if frame.function in READS and answered:
            return Passage()
        return Passage(acts=True, answered=answered, written=frame)

    def carry(self, frame: Frame, held: Frame | None) -> Conversation[Frame, Frame | None]:
        if not self._is_answered(frame):
            yield Tell(frame)
            return None
        if frame.answers(frame):
            yield from Master(frame.address).learn_echo()
        return (yield Ask(frame, repeatable=frame.function in READS))

    def let_go(self, held: Frame) -> Conversation[Frame, None]:
        """Nothing needs to be said."""
        return
        yield

    def outcome(self, answer: Frame | None) -> Outcome:
        if answer is not None and answer.is_refusal:
            return Outcome.NOT_APPLIED
        return Outcome.UNVERIFIED

    def _is_answered(self, frame: Frame) -> bool:
        return frame.address <= LAST_ADDRESS and frame.address != self._broadcast
