"""What a scan is to look for, and in which order: its rounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.exchange import LATE
from multidrop.numerals import whole_number
from multidrop.protocols import PROTOCOLS
from multidrop.timing import Format, LineSettings

WAIT = 0.08
"""s for the first byte of an answer in the quick pass; later ones count too, up to `LATE`."""
LISTEN = 2.0
"""s of silence that a line must have shown before the first probe."""
FIXED = "tcp://"
"""Ports whose baud rate and format are set on the other side."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to look for; empty is whatever the protocols' documents say."""

    protocols: tuple[str, ...] = ()
    bauds: tuple[int, ...] = ()
    formats: tuple[str, ...] = ()
    addresses: tuple[int, ...] = ()
    all_settings: bool = False
    first: bool = False
    anyway: bool = False
    wait: float = WAIT
    listen: float = LISTEN


@dataclass(frozen=True, slots=True)
class Round:
    """One protocol at one setting."""

    protocol: str
    baud: int
    format: str
    addresses: tuple[int, ...]

    @property
    def module(self) -> ProtocolModule:
        return PROTOCOLS[self.protocol]

    @property
    def settings(self) -> LineSettings:
        return self.module.line.with_options(baud=self.baud, format=Format.parse(self.format))

    def seconds(self, wait: float) -> float:
        """How long the quick pass takes where nobody answers."""
        prober, character = self.module.prober, self.settings.character
        probes = (prober.probe(address).encode() for address in self.addresses)
        return sum(len(raw) * character + wait for raw in probes) + LATE

    def __str__(self) -> str:
        return f"{self.protocol} {self.baud} {self.format}"


def rounds(wanted: Wanted, port: str) -> list[Round]:
    """The rounds of a scan, the usual setting of each protocol first. Raises `UsageError`."""
    fixed = port.startswith(FIXED)
    if fixed and (wanted.all_settings or len(wanted.bauds) > 1 or len(wanted.formats) > 1):
        raise UsageError(
            f"{port}: baud rate and format are set in the device server there; set them, and scan again"
        )
    found = [_rounds_of(name, wanted) for name in wanted.protocols or PROTOCOLS]
    if not any(found):
        raise UsageError("none of these addresses exists in these protocols")
    usual = [of_one[0] for of_one in found if of_one]
    others = [item for of_one in found for item in of_one[1:]]
    every = [*usual, *others]
    for item in every:
        item.settings.timing(network=fixed)  # a rate or format that does not exist is refused here
    settings = list(dict.fromkeys((item.baud, item.format) for item in every))
    return sorted(every, key=lambda item: settings.index((item.baud, item.format)))


def _rounds_of(name: str, wanted: Wanted) -> list[Round]:
    prober = PROTOCOLS[name].prober
    addresses = tuple(
        address
        for address in prober.addresses
        if not wanted.addresses or address in wanted.addresses
    )
    if not addresses:
        return []
    most = None if wanted.all_settings else 1
    bauds = wanted.bauds or tuple(prober.bauds)[:most]
    formats = wanted.formats or tuple(str(item) for item in tuple(prober.formats)[:most])
    return [Round(name, baud, form, addresses) for baud in bauds for form in formats]


def parse_addresses(text: str) -> tuple[int, ...]:
    """`0..31`, `5`, `0,2,7..9`, decimal or 0x hex. Raises `UsageError`."""
    found: set[int] = set()
    for part in text.split(","):
        low, dots, high = part.partition("..")
        try:
            first = whole_number(low)
            last = whole_number(high) if dots else first
        except ValueError:
            first, last = 1, 0
        if not 0 <= first <= last <= 255:
            raise UsageError(f"addresses {text!r} are not of the form 0..31 or 0,2,7..9")
        found.update(range(first, last + 1))
    return tuple(sorted(found))


def check_protocols(names: Sequence[str]) -> tuple[str, ...]:
    """Raises `UsageError` for a protocol that there is not."""
    for name in names:
        if name not in PROTOCOLS:
            raise UsageError(f"there is no protocol {name!r}; protocols are {', '.join(PROTOCOLS)}")
    return tuple(dict.fromkeys(names))
