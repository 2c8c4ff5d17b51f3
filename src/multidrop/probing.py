"""What a scan needs of a protocol: whom to ask, at which settings, what, and who it is that answered.

Nothing in here changes a device: a probe is a read, and so is every step of `identify`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from multidrop.conversation import Conversation
from multidrop.decoder import Decoder
from multidrop.timing import Format, Timing


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a device is, as far as its answers tell.

    `profile` is the protocol's own name where no model is sure; `behind` is what
    is connected behind the device; `note` is what else it said, for a person.
    """

    profile: str
    behind: str | None = None
    note: str = ""


class Prober(Protocol):
    """How a protocol looks for its devices. Of bauds and formats the usual ones stand first."""

    @property
    def addresses(self) -> Sequence[int]: ...
    @property
    def bauds(self) -> Sequence[int]: ...
    @property
    def formats(self) -> Sequence[Format]: ...

    def probe(self, address: int) -> Any:
        """The shortest read that any device at `address` answers, be it with a refusal.

        The frame never answers itself: the echo of a line that hears itself is no device.
        """
        ...

    def identify(self, address: int) -> Conversation[Any, Identity]:
        """Find out with reads who it is that answered the probe. Raises what `Ask` raises."""
        ...


def next_probe_at(until: float, last_heard: float, decoder: Decoder[Any], timing: Timing) -> float:
    """When the next probe may be sent: the answer to the last one is waited for `until` then.

    Not before the line has rested, and not over a frame that is still coming; but a
    line that never falls silent does not stop a scan for longer than a frame takes.
    """
    at = max(until, last_heard + timing.gap)
    if decoder.unfinished:
        at = max(at, last_heard + timing.silence)
    return min(at, until + timing.longest_frame * timing.character + timing.silence)
