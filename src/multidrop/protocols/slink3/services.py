"""What a slave is asked besides its parameters: status, faults, its serial interface, raw commands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from multidrop.conversation import Conversation, Wait
from multidrop.device import Report
from multidrop.errors import NoReply, NotApplied, OutcomeUnknown, UsageError
from multidrop.profile import Profile
from multidrop.protocols.slink3 import status as named
from multidrop.protocols.slink3.dialects import Dialect
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.master import NO_REFUSALS, Master, StatusWord
from multidrop.protocols.slink3.messages import Command, command_name, response_meaning
from multidrop.protocols.slink3.points import parse_point
from multidrop.protocols.slink3.values import Format

CLEAR_ATTEMPTS, CLEAR_EVERY = 20, 0.1
"""After a fault reset the state is asked for every 0.1 s, for up to 2 s."""

_MOVING = (
    named.State.OPERATION_ENABLED,
    named.State.QUICK_STOP_ACTIVE,
    named.State.FAULT_REACTION_ACTIVE,
)


def status(master: Master) -> Conversation[Frame, Report]:
    """Status word and malfunction code of a drive, the fault bit of a card. Raises `UsageError` at once."""
    if Command.STATUS_WORD in master.dialect.commands:
        return _drive_status(master)
    if not master.dialect.fault_bit:
        raise UsageError(
            f"{master.dialect.name} has no status word, malfunction code or fault bit; read a parameter instead"
        )
    return _card_status(master)


def _drive_status(master: Master) -> Conversation[Frame, Report]:
    word = yield from master.status_word()
    malfunction = yield from master.malfunction_code()
    fields: dict[str, Any] = {
        "fault": word.fault,
        "status_word": word.word,
        "state": word.state.value,
        "bits": word.bits,
        "malfunction_code": malfunction.code,
        "malfunction_family": malfunction.family,
    }
    family = f" ({malfunction.family})" if malfunction.family else ""
    return Report(
        fields,
        (
            f"state              {word.state.value}",
            f"fault bit          {'FAULT' if word.fault else 'no fault'}",
            f"malfunction code   {malfunction.code:04X}h{family}",
            f"status word        {word.word:04X}h",
            *(f"                   {bit}" for bit in word.bits),
        ),
    )


def _card_status(master: Master) -> Conversation[Frame, Report]:
    """A card has no status word; every answer carries its fault bit, so its address is read."""
    found = yield from master.read_typed(511)
    return Report(
        {"fault": found.fault, "status_word": None, "state": None, "malfunction_code": None},
        (
            f"fault bit          {'FAULT' if found.fault else 'no fault'}",
            f"{master.dialect.name} has no status word and no malfunction code",
        ),
    )


def running(master: Master) -> Conversation[Frame, str | None]:
    """The state of a drive that moves, or may; None for one at rest, and for a card, which cannot say."""
    if Command.STATUS_WORD not in master.dialect.commands:
        return None
    word = yield from master.status_word()
    return word.state.value if word.state in _MOVING else None


def clear_faults(master: Master) -> Conversation[Frame, Report]:
    """A fault reset, where the dialect knows the state that shows it. Raises `UsageError` at once."""
    if Command.STATUS_WORD not in master.dialect.commands:
        raise UsageError(f"{master.dialect.name} has no command that clears faults")
    return _clear_faults(master)


def _clear_faults(master: Master) -> Conversation[Frame, Report]:
    """A rising edge of the control word's fault reset bit; never a bit that enables."""
    before = yield from master.status_word()
    if before.state is not named.State.FAULT:
        return Report(
            {"cleared": False, "was": before.state.value, "state": before.state.value},
            (f"not in fault: {before.state.value}; nothing was written",),
        )
    if not before.word & named.REMOTE:
        raise UsageError(
            "control is local (status word bit 9 is 0): clear the fault at the keypad; nothing was written"
        )
    for word in (named.DISABLE_VOLTAGE, named.FAULT_RESET, named.DISABLE_VOLTAGE):
        yield from _control(master, word)
    after = yield from _state_after_reset(master)
    if after.state is not named.State.SWITCH_ON_DISABLED:
        raise NotApplied(
            f"the fault reset was sent; the drive is still in state {after.state.value}",
            found=after.state.value,
        )
    return Report(
        {"cleared": True, "was": before.state.value, "state": after.state.value},
        (f"fault cleared: {after.state.value}",),
    )


def _control(master: Master, word: int) -> Conversation[Frame, None]:
    try:
        yield from master.write_standard(named.CONTROL_WORD, 0, Format.UNSIGNED_SHORT_INT, word)
    except NoReply as failure:
        raise OutcomeUnknown(
            f"control word {word:04X}h went out and was not answered ({failure}); look at the drive",
            step=f"control word {word:04X}h",
        ) from failure


def _state_after_reset(master: Master) -> Conversation[Frame, StatusWord]:
    try:
        after = yield from master.status_word()
        for _ in range(CLEAR_ATTEMPTS):
            if after.state is named.State.SWITCH_ON_DISABLED:
                break
            yield Wait(CLEAR_EVERY)
            after = yield from master.status_word()
    except NoReply as failure:
        raise OutcomeUnknown(
            f"the fault reset was sent, and the drive's state cannot be read ({failure}); look at the drive",
            step="the state after the fault reset",
        ) from failure
    return after


def reset_comm(master: Master) -> Conversation[Frame, Report]:
    """Reset slave: its serial interface. Raises `UsageError` at once."""
    if Command.RESET_SLAVE not in master.dialect.commands:
        raise UsageError(f"{master.dialect.name} has no reset of its serial interface")
    return _reset_comm(master)


def _reset_comm(master: Master) -> Conversation[Frame, Report]:
    yield from master.reset()
    return Report({"reset": True}, ("the slave's serial interface was reset; faults stay",))


def prepare_raw(master: Master, text: str) -> Callable[[], Conversation[Frame, Report]]:
    """`[DEST/]` and COMMAND with its DATA, in hex. Raises `UsageError`."""
    destination, body = _raw_body(text, master.dialect)
    code = body[0] | body[1] << 8
    data = body[2:]
    frame = Frame(master.address, 0, destination << 1, code, data)

    def converse() -> Conversation[Frame, Report]:
        reply = yield from master.command(code, data, frame.destination)
        return Report(
            {
                "command": command_name(code),
                "response": reply.code,
                "text": response_meaning(reply.code),
                "data": reply.data.hex(),
                "fault": reply.in_fault if master.dialect.fault_bit else None,
            },
            (
                f"{command_name(code)}: {reply.code:04X}h {response_meaning(reply.code)}",
                f"data {reply.data.hex(' ').upper() or 'none'}",
            ),
            refused=reply.code not in NO_REFUSALS,
        )

    return converse


def _raw_body(text: str, dialect: Dialect) -> tuple[int, bytes]:
    where, slash, hex_text = text.rpartition("/")
    destination = 0
    if slash:
        destination = parse_point(f"{where}/0", Profile("", ""), dialect).destination
    try:
        body = bytes.fromhex(hex_text)
    except ValueError:
        raise UsageError(
            f"{hex_text!r} is not hex bytes: COMMAND low, COMMAND high, DATA, as in '23 00'"
        ) from None
    if len(body) < 2:
        raise UsageError("a command body has at least the two bytes of COMMAND, low byte first")
    return destination, body
