"""Which protocol a line speaks: the decoders of several hear the same bytes, and frames tell.

A scan asks this before it speaks, a sniffer before it can show anything, a doctor at
each setting that it tries. They differ in how many frames they want to have heard.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from multidrop.decoder import Decoder
from multidrop.device import ProtocolModule
from multidrop.events import Damaged, FrameReceived

LEAST_FRAME = 6
"""Bytes: a shorter frame has no checksum, and proves nothing."""
SHARE = 0.5
"""Of the bytes since its first frame that have to be in frames: chance makes one now and then."""
GLITCH = 3
"""So few damaged bytes are what a transmitter makes that is switched on, and nobody's traffic."""


class Piece(NamedTuple):
    """Bytes as they came."""

    data: bytes
    now: float
    damaged: bool


@dataclass(slots=True)
class Ear:
    """One protocol's decoder, and what it has made of what it heard."""

    protocol: ProtocolModule
    decoder: Decoder[Any]
    frames: int = 0  # whole ones
    in_frames: int = 0  # bytes of these
    heard: int = 0  # bytes, from the first of these on

    def receive(
        self, data: bytes, *, damaged: bool = False
    ) -> Sequence[FrameReceived[Any] | Damaged]:
        """Take bytes; `damaged` ones carry the port's mark of a parity error. Returns what they complete."""
        decoder = self.decoder
        return self._count(decoder.line_error(data) if damaged else decoder.receive_data(data))

    def silence(self) -> Sequence[FrameReceived[Any] | Damaged]:
        """The line fell silent: what is incomplete stays so."""
        return self._count(self.decoder.silence())

    def _count(
        self, events: Sequence[FrameReceived[Any] | Damaged]
    ) -> Sequence[FrameReceived[Any] | Damaged]:
        for event in events:
            if isinstance(event, FrameReceived) and len(event.raw) >= LEAST_FRAME:
                self.frames += 1
                self.in_frames += len(event.raw)
            elif not self.frames:
                continue
            self.heard += len(event.raw)
        return events

    def understands(self, frames: int) -> bool:
        """Whether these are `frames` or more of its frames, and they are most of what came since."""
        return self.frames >= frames and self.in_frames >= SHARE * self.heard


def told(ears: Iterable[Ear], frames: int) -> Ear | None:
    """The ear that understands; of several the one that makes most of what was heard."""
    return max(
        (ear for ear in ears if ear.understands(frames)),
        key=lambda ear: ear.in_frames,
        default=None,
    )
