"""How a device is named: `PROFILE:ADDRESS@PORT[,key=value]...`, and the keys behind it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from multidrop.errors import UsageError
from multidrop.numerals import decimal_number, whole_number
from multidrop.profile import nearest
from multidrop.timing import Format

GRAMMAR = (
    "PROFILE:ADDRESS@PORT[,key=value]..., as in slink3:2@/dev/ttyUSB0 or "
    "flexmax:0@tcp://10.0.0.7:4001,timeout=0.5"
)

LINE_KEYS = {
    "baud": "baud rate",
    "format": "data bits, parity, stop bits, such as 8E1",
    "timeout": "s to wait for the first byte of an answer",
    "attempts": "how often a read is asked",
    "silence": "s without a byte that cut a frame short",
    "echo": "auto, on or off: whether the line hears itself",
    "rts": "on, off or leave, when the port is opened",
    "dtr": "on, off or leave, when the port is opened",
    "direction": "auto or kernel: who switches an RS-485 transmitter",
}
_CHOICES = {
    "echo": ("auto", "on", "off"),
    "rts": ("on", "off", "leave"),
    "dtr": ("on", "off", "leave"),
    "direction": ("auto", "kernel"),
}


@dataclass(frozen=True, slots=True)
class LineOptions:
    """What a user set of a line; None where the profile or the protocol decides.

    `own` holds the keys that a protocol added, as text.
    """

    baud: int | None = None
    format: Format | None = None
    timeout: float | None = None
    attempts: int | None = None
    silence: float | None = None
    echo: str = "auto"
    rts: str = "on"
    dtr: str = "on"
    direction: str = "auto"
    own: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def parse(cls, options: Mapping[str, str], own_keys: Mapping[str, str]) -> LineOptions:
        """Options as text. Raises `UsageError` for an unknown key or a value out of range."""
        parsed: dict[str, object] = {}
        own = {}
        for key, text in options.items():
            if key in own_keys:
                own[key] = text
            elif key not in LINE_KEYS:
                known = {**LINE_KEYS, **own_keys}
                raise UsageError(
                    f"unknown key {key!r}{nearest(key, known)}; keys are {' '.join(known)}"
                )
            else:
                parsed[key] = _value(key, text)
        return cls(**parsed, own=own)  # type: ignore[arg-type]

    @property
    def hears_itself(self) -> bool | None:
        """True, False, or None where that is to be found out."""
        return {"auto": None, "on": True, "off": False}[self.echo]

    def line_settings(self) -> dict[str, object]:
        """What of these goes into `LineSettings`."""
        return {
            "baud": self.baud,
            "format": self.format,
            "timeout": self.timeout,
            "attempts": self.attempts,
            "silence": self.silence,
        }


def _value(key: str, text: str) -> object:
    if key in _CHOICES:
        if text not in _CHOICES[key]:
            raise UsageError(f"{key}={text!r} is none of {', '.join(_CHOICES[key])}")
        return text
    if key == "format":
        return Format.parse(text)
    try:
        return whole_number(text) if key in ("baud", "attempts") else decimal_number(text)
    except ValueError:
        raise UsageError(f"{key}={text!r} is not a number") from None


@dataclass(frozen=True, slots=True)
class DeviceName:
    """A device as the command line names it. `address` is None for a broadcast."""

    profile: str
    address: int | None
    port: str
    options: Mapping[str, str]

    def __str__(self) -> str:
        where = "" if self.address is None else f":{self.address}"
        return f"{self.profile}{where}@{self.port}"


def parse_device(text: str, *, broadcast: bool = False) -> DeviceName:
    """Raises `UsageError` with the grammar."""
    who, at, where = text.partition("@")
    if not at or not who or where.startswith(",") or not where:
        if broadcast:
            raise UsageError(f"{text!r} is not a line: PROFILE@PORT, as in flexmax@/dev/ttyUSB0")
        raise UsageError(f"{text!r} is not a device: {GRAMMAR}")
    port, options = parse_port(where)
    if broadcast:
        if ":" in who:
            raise UsageError(f"{text!r}: a broadcast has no address: PROFILE@PORT")
        return DeviceName(who, None, port, options)
    return DeviceName(*_who(who, text), port, options)


def parse_port(text: str) -> tuple[str, dict[str, str]]:
    """`PORT[,key=value]...`. Raises `UsageError`."""
    port, *pairs = text.split(",")
    if not port:
        raise UsageError(f"{text!r} is not a port: PORT[,key=value]..., as in /dev/ttyUSB0")
    options = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not value:
            raise UsageError(f"{text!r}: {pair!r} is not key=value")
        options[key.strip()] = value.strip()
    return port, options


def _who(who: str, text: str) -> tuple[str, int]:
    profile, colon, address = who.partition(":")
    if not colon or not profile or not re.fullmatch(r"[0-9]+|0[xX][0-9a-fA-F]+", address):
        raise UsageError(f"{text!r} is not a device: {GRAMMAR}")
    return profile, whole_number(address)


def parse_simulated(text: str) -> tuple[str, int, str | None]:
    """`PROFILE:ADDRESS[+OPTION]`, as in `flexmax:1+dgfc386`: profile, address, what is behind it."""
    who, _, option = text.partition("+")
    if ":" not in who or "@" in who:
        raise UsageError(
            f"{text!r} is not a device to simulate: PROFILE:ADDRESS, as in flexmax:0 or flexmax:0+dgfc386"
        )
    profile, address = _who(who, text)
    return profile, address, option or None
