"""Datalink on a line that many masters share.

A change waits in its instrument for the Acknowledge of the master that sent it:
anybody else's command would drop it, and anybody else's Acknowledge would carry
it out. So it holds the line, and an Acknowledge passes only for its own change.
"""

from __future__ import annotations

from multidrop.conversation import Ask, Conversation, Tell, TooLate
from multidrop.errors import NotApplied
from multidrop.protocols.datalink.frame import Command, Frame, UnstuffedFrame
from multidrop.protocols.datalink.master import ACKNOWLEDGE_WITHIN, Master
from multidrop.relay import Passage
from multidrop.writing import Outcome

_CHANGES = frozenset({Command.CHANGE, Command.CHANGE_BITS})


class DatalinkRelay:
    def shows(self, frame: Frame) -> bool:
        """An Acknowledge is two bytes without an LRC: it shows nothing."""
        return frame.command not in (Command.RESPONSE, Command.ACKNOWLEDGE)

    def passage(self, frame: Frame, held: Frame | None) -> Passage[Frame] | str:
        if frame.command is Command.RESPONSE:
            return "an answer, and no request"
        if frame.command is Command.INTERROGATE:
            return Passage()
        if frame.command in _CHANGES:
            return Passage(acts=True, hold=ACKNOWLEDGE_WITHIN)
        if held is None or held.address != frame.address:
            return "no change of this master waits for it"
        return Passage(acts=True, answered=False, written=held)

    def carry(self, frame: Frame, held: Frame | None) -> Conversation[Frame, Frame | None]:
        if frame.command is not Command.ACKNOWLEDGE:
            if held is not None and held.address != frame.address:
                yield from self.let_go(held)
            # nothing happens before the Acknowledge
            return (yield Ask(frame, repeatable=True, rests=frame.command in _CHANGES))
        assert held is not None
        try:
            yield Tell(frame, within=ACKNOWLEDGE_WITHIN)
        except TooLate:
            yield from self.let_go(held)
            raise NotApplied(
                f"it came more than {ACKNOWLEDGE_WITHIN * 1000:.0f} ms after the echo of its change,"
                " which was dropped with an Interrogate instead",
                found=None,
            ) from None
        return None

    def let_go(self, held: Frame) -> Conversation[Frame, None]:
        """Drop the change with an Interrogate."""
        master = Master(held.address, stuffing=not isinstance(held, UnstuffedFrame))
        yield from master.drop(held)

    def outcome(self, answer: Frame | None) -> Outcome:
        """Nothing answers an Acknowledge."""
        return Outcome.UNVERIFIED
