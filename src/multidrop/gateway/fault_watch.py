"""Which devices are in fault, by what is polled anyway. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from multidrop.gateway.values import Key, Update


class Change(StrEnum):
    """What has become of a device."""

    TRIPPED = "tripped"
    FOUND = "found in fault"  # it was, when it was first heard
    CLEAR = "clear"  # its fault is gone, or it had none when it was first heard


@dataclass(frozen=True, slots=True)
class FaultChange:
    """A device that tripped, or is clear. `update` is what said so."""

    device: str
    change: Change
    update: Update


class _Witness(NamedTuple):
    """Who says whether there is a fault: the bit of the answers of what is there, or a word."""

    kind: str
    name: str


BIT, WORD = "bit", "word"


class FaultWatch:
    """Listens to `Values`, and tells its own listeners of every change.

    A device has several witnesses: the fault bit of its answers, the one of a card
    behind it, words with fault bits. It is in fault while one of them says so.
    """

    def __init__(self) -> None:
        self.listeners: list[Callable[[FaultChange], None]] = []
        self._said: dict[str, dict[_Witness, bool]] = {}  # device -> witness -> its last word

    def state(self, device: str) -> bool | None:
        """Whether a device is in fault; None where nobody has said anything of it yet."""
        said = self._said.get(device)
        return None if said is None else any(said.values())

    def take(self, update: Update) -> None:
        """A listener of `Values`. What was not just read says nothing."""
        if not update.good:
            return
        for witness, fault in _said_by(update):
            known = self._said.get(update.device)
            if known is not None and known.get(witness) is fault:
                continue  # as it said before
            before = self.state(update.device)
            said = self._said.setdefault(update.device, {})
            first, said[witness] = witness not in said, fault
            after = any(said.values())
            if after == before:
                continue
            change = Change.TRIPPED if after else Change.CLEAR
            if after and first:
                change = Change.FOUND
            for listener in self.listeners:
                listener(FaultChange(update.device, change, update))

    def keep_only(self, keys: Iterable[Key]) -> None:
        """Forget devices, and fault words, of which no point is polled any more."""
        kept = set(keys)
        devices = {device for device, _ in kept}
        for device, said in list(self._said.items()):
            for witness in [word for word in said if word.kind == WORD]:
                if (device, witness.name) not in kept:
                    del said[witness]
            if device not in devices or not said:
                del self._said[device]


def _said_by(update: Update) -> Iterator[tuple[_Witness, bool]]:
    """Who says of the device's fault what: the bit of the answer, the value of a fault word."""
    point, reading = update.polled.point, update.polled.reading
    if reading is None:
        return
    if reading.fault is not None:
        yield _Witness(BIT, point.within), reading.fault
    if point.description is not None:
        fault = point.description.says_fault(reading.value)
        if fault is not None:
            yield _Witness(WORD, update.point), fault
