"""What each model implements: the tables of A chapters 3 and 5, B chapters 3 to 5, and A chapter 10.

A dialect is data. Master and slave ask it; neither knows a model by name.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from multidrop.protocols.slink3.messages import Command, Response
from multidrop.protocols.slink3.values import Format


@dataclass(frozen=True, slots=True)
class Dialect:
    name: str
    commands: frozenset[Command]
    formats: frozenset[Format]
    broadcast: int = 255
    subindex: bool = True
    fault_bit: bool = True
    frame_error_means_unread: bool = True
    """0097 says only that the slave did not take the frame, so a read may be asked again."""
    behind: str | None = None
    """The dialect that destination ID 2 leads to."""
    refusals: dict[int, Response] = field(default_factory=dict)
    """What the slave answers instead, where it knows fewer codes."""

    @property
    def names_types(self) -> bool:
        """Whether a read of type void is answered with the parameter's own type."""
        return Format.VOID in self.formats

    def refusal(self, response: int) -> int:
        """What the slave answers for a RESPONSE, known or not."""
        return self.refusals.get(response, response)


_TYPED = {Command.READ_TYPED_PARAMETER, Command.WRITE_TYPED_PARAMETER}
_DRIVE = _TYPED | {
    Command.RESET_SLAVE,
    Command.STATUS_WORD,
    Command.READ_STANDARD_PARAMETER,
    Command.WRITE_STANDARD_PARAMETER,
    Command.BROADCAST_COMMAND_VERIFY,
    Command.MALFUNCTION_CODE,
}
_NUMBERS = {
    Format.SHORT_INT,
    Format.LONG_INT,
    Format.UNSIGNED_SHORT_INT,
    Format.UNSIGNED_LONG_INT,
    Format.FLOAT,
}

FLEXMAX = Dialect(
    name="flexmax",
    commands=frozenset(_DRIVE),
    formats=frozenset(_NUMBERS | {Format.STRING}),
    behind="dgfc386",
)
DGFC386 = Dialect(
    name="dgfc386",
    commands=frozenset(_TYPED | {Command.SPECIAL_ACCESS}),
    formats=frozenset(_NUMBERS | {Format.VOID, Format.BOOLEAN, Format.CHAR, Format.UNSIGNED_CHAR}),
    behind="flexmax",
)
AX_V = Dialect(
    name="ax-v",
    commands=frozenset(_TYPED),
    formats=frozenset(_NUMBERS | {Format.VOID, Format.BOOLEAN}),
    broadcast=128,
    subindex=False,
    fault_bit=False,
    frame_error_means_unread=False,
    # It knows 0000, 0001, 0018, 001E and 0097 (B chapter 4).
    refusals={
        Response.TYPE_VALUE_ERROR: Response.TYPE_UNKNOWN,
        Response.DESTINATION_NOT_EXIST: Response.FRAME_ERROR,
        Response.ABOVE_MAXIMUM: Response.FRAME_ERROR,
        Response.BELOW_MINIMUM: Response.FRAME_ERROR,
        Response.READ_ONLY_PARAMETER: Response.FRAME_ERROR,
        Response.WRITE_NOT_ALLOWED: Response.FRAME_ERROR,
        Response.LENGTH_ERROR: Response.FRAME_ERROR,
    },
)
SLINK3 = Dialect(
    name="slink3",
    commands=frozenset(_DRIVE | {Command.SPECIAL_ACCESS}),
    formats=frozenset(FLEXMAX.formats | DGFC386.formats | AX_V.formats),
    behind="dgfc386",
)

DIALECTS = {dialect.name: dialect for dialect in (SLINK3, FLEXMAX, AX_V, DGFC386)}

BEHIND = 2
"""The destination ID of the DGFC386 behind a drive, and of the drive behind a DGFC386 (A 10)."""

TYPES_TO_TRY = (
    Format.SHORT_INT,
    Format.LONG_INT,
    Format.UNSIGNED_SHORT_INT,
    Format.UNSIGNED_LONG_INT,
    Format.FLOAT,
    Format.STRING,
)
"""The order in which a read without a type asks a dialect that does not name types."""
