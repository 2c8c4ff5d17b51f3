"""What a drive is asked besides its parameters."""

from __future__ import annotations

from multidrop.conversation import Conversation
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.master import Master
from multidrop.protocols.slink3.messages import Command
from multidrop.protocols.slink3.status import State

_MOVING = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE)


def running(master: Master) -> Conversation[Frame, str | None]:
    """The state of a drive that moves, or may; None for one at rest, and for a card, which cannot say."""
    if Command.STATUS_WORD not in master.dialect.commands:
        return None
    word = yield from master.status_word()
    return word.state.value if word.state in _MOVING else None
