"""What opens the configuration port at the front of some instruments (N): bytes that are no message.

They are sent when a person asks for it by name, and never otherwise: on a line
with several instruments, and on any other port, nobody knows what they do.
"""

from __future__ import annotations

from multidrop.conversation import Conversation, Tell, Wait
from multidrop.errors import NoReply
from multidrop.protocols.datalink.frame import Command, Frame
from multidrop.protocols.datalink.master import Master

ENTRY = bytes.fromhex("03 1B 0E 15")

ANSWERED_WITHIN = 0.5
"""s in which the echo `1B 20 0E 20 15` comes; no source says how soon. It is heard as damage."""

ACTION = "open_configuration_port"
MEANING = (
    "sends the entry sequence 03 1B 0E 15 of a configuration port, which then answers for 30 s"
)


class EntrySequence(Frame):
    """The sequence in the place of a frame, to be told; nobody answers it with a frame."""

    __slots__ = ()

    def encode(self, stuffing: bool = True) -> bytes:
        return ENTRY


def open_port(master: Master, memory_address: int) -> Conversation[Frame, None]:
    """Send the sequence and read a byte of memory, which shows that the port is open. Raises `NoReply`."""
    yield Tell(EntrySequence(Command.ACKNOWLEDGE, master.address))
    yield Wait(ANSWERED_WITHIN)
    try:
        yield from master.interrogate(memory_address, 1)
    except NoReply as failure:
        raise NoReply(
            failure.attempts,
            failure.damaged,
            failure.heard,
            because=f"the configuration port did not open: {failure.because}",
        ) from failure
