"""Status, faults, serial port and raw commands of a drive."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from multidrop.conversation import Ask, Conversation
from multidrop.device import Report
from multidrop.errors import Error, NoReply, NotApplied, OutcomeUnknown, ProtocolError, UsageError
from multidrop.protocols.ultra3000 import status as named
from multidrop.protocols.ultra3000.frame import REFUSED, Frame
from multidrop.protocols.ultra3000.master import Master
from multidrop.protocols.ultra3000.messages import (
    DRIVE_STATUS,
    FAULT_STATUS,
    FIRMWARE_VERSION,
    PRODUCT_TYPE,
    RESET_FAULTS,
    RESET_SERIAL_PORT,
    RUN_STATUS,
    function_name,
    refusal_meaning,
)


def status(master: Master) -> Conversation[Frame, Report]:
    """Drive status, fault status, run status, product type and firmware."""
    product = named.product((yield from master.read_number(PRODUCT_TYPE, 8)))
    version = yield from master.read_number(FIRMWARE_VERSION, 4)
    drive = yield from master.read_number(DRIVE_STATUS, 8)
    faults = named.bits_set((yield from master.read_number(FAULT_STATUS, 8)), named.FAULT_STATUS)
    run = yield from master.read_number(RUN_STATUS, 2)
    firmware = f"{version >> 8}.{version & 0xFF:02}"
    code = 0 if run in (named.RUNNING, named.STOPPED) else run
    fields: dict[str, Any] = {
        "fault": bool(faults or code),
        "status_word": drive,
        "state": named.run_status(run),
        "malfunction_code": code,
        "enabled": bool(drive & named.ENABLED),
        "bits": named.bits_set(drive, named.DRIVE_STATUS),
        "faults": faults,
        "product_type": product,
        "firmware": firmware,
    }
    return Report(
        fields,
        (
            f"run status         {named.run_status(run)}",
            f"drive              {'enabled' if fields['enabled'] else 'disabled'}",
            f"faults             {', '.join(faults) or 'none'}",
            f"drive status       {drive:08X}h",
            *(f"                   {bit}" for bit in fields["bits"]),
            f"product type       {product}",
            f"firmware           {firmware}",
        ),
    )


def running(master: Master) -> Conversation[Frame, str | None]:
    """Whether the drive is enabled."""
    drive = yield from master.read_number(DRIVE_STATUS, 8)
    return "enabled" if drive & named.ENABLED else None


def act(master: Master, parameter: int, name: str) -> Conversation[Frame, None]:
    """An action, once. Raises `OutcomeUnknown` where it went out and was not answered."""
    yield from master.learn_echo()
    try:
        yield from master.act(parameter)
    except (NoReply, ProtocolError) as failure:
        raise OutcomeUnknown(
            f"{name} was sent and was not answered ({failure}); look at the drive", step=name
        ) from failure


def clear_faults(master: Master) -> Conversation[Frame, Report]:
    """Reset faults (06F), then read what is still there (074, and the code of 075)."""
    yield from act(master, RESET_FAULTS, "reset faults")
    try:
        word = yield from master.read_number(FAULT_STATUS, 8)
        run = yield from master.read_number(RUN_STATUS, 2)
    except Error as failure:
        raise OutcomeUnknown(
            f"the faults were reset, and whether one is still there cannot be read ({failure})",
            step="the faults after the reset",
        ) from failure
    faults = named.bits_set(word, named.FAULT_STATUS)
    if not faults and run not in (named.RUNNING, named.STOPPED):
        faults = [named.run_status(run)]
    if faults:
        raise NotApplied(
            f"the faults were reset; still there: {', '.join(faults)}", found=", ".join(faults)
        )
    state = named.run_status(run)
    return Report({"cleared": True, "state": state}, (f"no fault is left: {state}",))


def reset_comm(master: Master) -> Conversation[Frame, Report]:
    """Reset serial port (10A): a new address, baud rate or format acts from here on."""
    yield from act(master, RESET_SERIAL_PORT, "reset serial port")
    return Report(
        {"reset": True},
        (
            "the drive's serial port was reset: a new address, baud rate or format acts from now on",
            "faults stay: see clear-faults",
        ),
    )


_BODY = re.compile(r"([0-7][0-9a-fA-F]{2})([0-9a-fA-F])([0-9a-fA-F]*)")


def prepare_raw(master: Master, text: str) -> Callable[[], Conversation[Frame, Report]]:
    """Parameter, function and data as they stand in a frame. Raises `UsageError`."""
    body = _BODY.fullmatch(re.sub(r"\s", "", text))
    if body is None:
        raise UsageError(
            f"{text!r} is not a command: parameter (000 to 7FF), function and data, as in 0730 or 06B101"
        )
    frame = Frame(master.address, int(body[1], 16), int(body[2], 16), body[3].upper())
    name = function_name(frame.function)

    def converse() -> Conversation[Frame, Report]:
        answer = yield from _ask_raw(master, frame, name)
        code = int(answer.data, 16) if answer.is_refusal else 0
        text = refusal_meaning(code) if code else "OK"
        return Report(
            {
                "command": name,
                "parameter": f"0x{answer.parameter % REFUSED:03X}",
                "response": code,
                "text": text,
                "data": "" if code else answer.data,
            },
            (f"{name} {frame.parameter:03X}: {text}", f"data {answer.data or 'none'}"),
            refused=answer.is_refusal,
        )

    return converse


def _ask_raw(master: Master, frame: Frame, name: str) -> Conversation[Frame, Frame]:
    """Sent once. Only a read without data can be lost without harm."""
    if not frame.answers(frame):
        return (yield Ask(frame))
    yield from master.learn_echo()
    try:
        return (yield Ask(frame))
    except NoReply as failure:
        raise OutcomeUnknown(
            f"{name} {frame.parameter:03X} was sent and was not answered ({failure}); look at the drive",
            step=name,
        ) from failure
