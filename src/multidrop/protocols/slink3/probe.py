"""How a scan finds SLINK3 slaves, and tells FlexMax, AX-V and DGFC386 apart.

The probe is the status word (0023), the shortest command: a FlexMax gives it, the
others refuse it with 0018, and both show that somebody is there. What tells them
apart are the tables of A chapters 3 and 5, A chapter 10 and B chapters 3 to 5:
the commands and the types that each has.
"""

from __future__ import annotations

from multidrop.conversation import Ask, Conversation
from multidrop.probing import Identity
from multidrop.protocols.slink3.dialects import AX_V, BEHIND, DGFC386, FLEXMAX, SLINK3
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.messages import (
    Command,
    Response,
    TypedParameter,
    response_meaning,
)
from multidrop.protocols.slink3.values import Format
from multidrop.timing import Format as CharacterFormat

CARD_ADDRESS = 511, Format.UNSIGNED_CHAR
"""The DGFC386's own address, and a type that neither FlexMax nor AX-V has."""
DRIVE_ADDRESS = 8511, Format.UNSIGNED_SHORT_INT
PRINTED_IPA = 1009, Format.VOID
"""A parameter that the AX-V's manual prints; its slaves name the type (B chapter 5)."""


class Slink3Prober:
    addresses = range(128)
    bauds = (9600, 19200, 38400, 4800, 2400, 1200)
    """A 12.1 prints 9600 alone and says nothing of others, which drives of the family have."""
    formats = (CharacterFormat(8, "E", 1), CharacterFormat(8, "N", 1), CharacterFormat(8, "O", 1))

    def probe(self, address: int) -> Frame:
        return Frame(address, code=Command.STATUS_WORD)

    def identify(self, address: int) -> Conversation[Frame, Identity]:
        reply = yield Ask(self.probe(address), repeatable=True)
        if reply.code == Response.OK and len(reply.data) == 2:
            return (yield from _drive(address))
        if reply.code == Response.UNKNOWN_COMMAND:
            return (yield from _without_status(address))
        return _unknown(f"status word: {response_meaning(reply.code)}")


def _drive(address: int) -> Conversation[Frame, Identity]:
    """It has a status word. A FlexMax knows no void type, and may have a card behind it."""
    reply = yield from _read(address, (CARD_ADDRESS[0], Format.VOID))
    card = yield from _read(address, CARD_ADDRESS, BEHIND)
    behind = DGFC386.name if card.code == Response.OK else None
    profile = FLEXMAX if reply.code == Response.TYPE_UNKNOWN else SLINK3
    return Identity(profile.name, behind)


def _without_status(address: int) -> Conversation[Frame, Identity]:
    """A DGFC386 has its address at 511; an AX-V does not even have its type."""
    reply = yield from _read(address, CARD_ADDRESS)
    if reply.code == Response.OK:
        drive = yield from _read(address, DRIVE_ADDRESS, BEHIND)
        return Identity(DGFC386.name, FLEXMAX.name if drive.code == Response.OK else None)
    if reply.code == Response.TYPE_UNKNOWN:
        return Identity(AX_V.name)
    printed = yield from _read(address, PRINTED_IPA)
    if printed.code == Response.OK:
        return Identity(AX_V.name, note=f"by its IPA {PRINTED_IPA[0]}")
    return _unknown(f"no status word; parameter {CARD_ADDRESS[0]}: {response_meaning(reply.code)}")


def _unknown(note: str) -> Identity:
    return Identity(SLINK3.name, note=note)


def _read(
    address: int, parameter: tuple[int, Format], destination: int = 0
) -> Conversation[Frame, Frame]:
    """A typed read; the answer as it comes, for a refusal tells as much as a value."""
    index, type_code = parameter
    data = TypedParameter(type_code, index).encode()
    question = Frame(address, 0, destination << 1, Command.READ_TYPED_PARAMETER, data)
    return (yield Ask(question, repeatable=True))


PROBER = Slink3Prober()
