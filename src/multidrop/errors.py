"""Every exception that multidrop raises on purpose.

::

    multidrop.Error
    ├── UsageError       asked for what the protocol or profile cannot say; nothing was sent
    ├── DeviceError      the device understood and refused                   .code .meaning
    ├── NoReply          nothing valid came in time                          .attempts .damaged .heard
    ├── ProtocolError    a valid frame that breaks the rules                 .raw
    ├── OutcomeUnknown   a write went out; whether it was done is unknown    .step
    ├── NotApplied       a write went out; the read-back does not show it    .found
    └── PortError        the port could not be opened, or was lost

One tree, one question: whose turn is it to act? The user for `UsageError`, the
device's state for `DeviceError`, the wiring for `NoReply` and `PortError`, the
device's maker for `ProtocolError`, and a person who looks at the machine for
`OutcomeUnknown` and `NotApplied`. Any other exception is a bug of ours.
"""

from __future__ import annotations

from typing import ClassVar


class Error(Exception):
    """Base of everything below.

    `kind` is its name wherever it is written as JSON, `exit_status` that of a
    command which it ends: users' programs know both, so they stay as they are.
    """

    kind: ClassVar[str] = "failure"
    exit_status: ClassVar[int] = 1


class UsageError(Error):
    """What was asked cannot be said in this protocol, or the profile forbids it. Nothing was sent."""

    kind = "usage"
    exit_status = 2


class DeviceError(Error):
    """The device understood the request and refused it."""

    kind = "refused"
    exit_status = 3

    def __init__(self, code: int, meaning: str, *, fault: bool | None = None) -> None:
        super().__init__(meaning)
        self.code = code
        self.meaning = meaning
        self.fault = fault

    def __str__(self) -> str:
        return f"refused with code {self.code:04X}h: {self.meaning}"


class NoReply(Error):
    """No answer that could be believed came in time.

    `damaged` holds what arrived in pieces, `heard` the valid frames that were
    not the answer (another slave's, a late one), both as raw bytes.
    """

    kind = "no-reply"
    exit_status = 4

    def __init__(
        self,
        attempts: int,
        damaged: tuple[bytes, ...] = (),
        heard: tuple[bytes, ...] = (),
        *,
        because: str = "no reply",
    ) -> None:
        super().__init__(because)
        self.because = because
        self.attempts = attempts
        self.damaged = damaged
        self.heard = heard

    def __str__(self) -> str:
        text = f"{self.because} in {self.attempts} attempt{'s' if self.attempts != 1 else ''}"
        if self.damaged:
            text += f"; damaged bytes came: {shown(self.damaged)}"
        if self.heard:
            text += f"; frames that were not the answer came: {shown(self.heard)}"
        return text


class ProtocolError(Error):
    """A frame arrived whole and is ours, but says what the protocol does not allow."""

    kind = "protocol"
    exit_status = 6

    def __init__(self, message: str, raw: bytes = b"") -> None:
        super().__init__(message)
        self.raw = raw

    def __str__(self) -> str:
        message = super().__str__()
        return f"{message} (bytes {self.raw.hex(' ').upper()})" if self.raw else message


class OutcomeUnknown(Error):
    """A write went out and nobody can say whether it was carried out. `step` is where it was lost."""

    kind = "unknown-outcome"
    exit_status = 7

    def __init__(self, message: str, *, step: str) -> None:
        super().__init__(message)
        self.step = step


class NotApplied(Error):
    """A write went out and the read-back shows something else: `found`."""

    kind = "not-applied"
    exit_status = 8

    def __init__(self, message: str, *, found: object) -> None:
        super().__init__(message)
        self.found = found


class PortError(Error):
    """The port is missing, busy, not permitted, or was lost in the middle."""

    kind = "port"
    exit_status = 5


def shown(pieces: tuple[bytes, ...], most: int = 3) -> str:
    """Bytes for a message: at most `most` pieces of at most 32 bytes, in hex."""
    texts = [
        piece[:32].hex(" ").upper() + (" ..." if len(piece) > 32 else "") for piece in pieces[:most]
    ]
    if len(pieces) > most:
        texts.append(f"and {len(pieces) - most} more")
    return " | ".join(texts)
