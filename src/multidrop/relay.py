"""What a line that many masters share must know of their frames.

Each of them believes that it has the line for itself. So its frames pass one at a
time, and it hears the answers to its own requests only. Whether a frame may pass
at all, and for how long the line stays with its master behind it, a protocol says
in its `Relay`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from multidrop.conversation import Conversation
from multidrop.decoder import Decoder
from multidrop.events import Damaged, FrameReceived
from multidrop.writing import Outcome

FrameT = TypeVar("FrameT")


@dataclass(frozen=True, slots=True)
class Passage(Generic[FrameT]):
    """How one frame of a master passes over a shared line."""

    acts: bool = False
    """Whether it may change something: True for everything that is not known as a read."""
    answered: bool = True
    """Whether somebody answers it; nobody does a broadcast, or an acknowledge."""
    refusal: FrameT | None = None
    """What its master hears where it may not act; None: nothing."""
    hold: float | None = 0.0
    """s that the line stays with its master behind it, at most; None: as it was before."""
    written: FrameT | None = None
    """What a device does once this has gone out; a Datalink change only waits for its Acknowledge."""


class Relay(Protocol[FrameT]):
    """A protocol's frames on a shared line. `held` is what its master has the line for, if it has."""

    def shows(self, frame: FrameT) -> bool:
        """Whether whoever sends this is certainly a master of this protocol."""
        ...

    def passage(self, frame: FrameT, held: FrameT | None) -> Passage[FrameT] | str:
        """How it passes, or the reason why it does not."""
        ...

    def carry(self, frame: FrameT, held: FrameT | None) -> Conversation[FrameT, FrameT | None]:
        """Ask or tell it, once; returns the answer as its master expects it, None if there is none.

        Raises `NoReply`, and `NotApplied` where it came too late to be sent.
        """
        ...

    def let_go(self, held: FrameT) -> Conversation[FrameT, None]:
        """What the line says when a master that had it for `held` did not finish."""
        ...

    def outcome(self, answer: FrameT | None) -> Outcome:
        """What is known of a write that was answered so, or that nobody answers."""
        ...


MOST_GARBAGE = 255
"""Bytes that may come before a master's first whole frame, as of one that was cut short. What sends
more is no master: a web browser, say, which a page can make send anything behind its headers."""


class Recognition:
    """Tells which protocol somebody speaks, by the first whole frame that shows it, and decodes it then."""

    def __init__(
        self, decoders: Mapping[str, Decoder[Any]], relays: Mapping[str, Relay[Any]]
    ) -> None:
        self.protocol: str | None = None  # the name, once it is known
        self.hopeless = False  # this is no master of any of them
        self._decoders = decoders
        self._relays = relays
        self._count = 0

    @property
    def pending(self) -> bool:
        """Whether bytes are held that have not come out as events."""
        if self.protocol is not None:
            return self._decoders[self.protocol].pending
        return any(decoder.pending for decoder in self._decoders.values())

    def receive_data(self, data: bytes) -> list[FrameReceived[Any] | Damaged]:
        """The events of the protocol from the frame on that shows it; nothing before."""
        if self.protocol is not None:
            return self._told(data)
        for at in range(len(data)):
            if self.hopeless:
                break
            self._count += 1
            events = self._look(
                {
                    name: decoder.receive_data(data[at : at + 1])
                    for name, decoder in self._decoders.items()
                }
            )
            if self.protocol is not None:
                return events + self._told(data[at + 1 :])
        return []

    def silence(self) -> list[FrameReceived[Any] | Damaged]:
        """Whoever it is fell silent: what is incomplete now stays incomplete."""
        if self.protocol is not None:
            return self._decoders[self.protocol].silence()
        return self._look({name: decoder.silence() for name, decoder in self._decoders.items()})

    def _told(self, data: bytes) -> list[FrameReceived[Any] | Damaged]:
        assert self.protocol is not None
        return self._decoders[self.protocol].receive_data(data)

    def _look(
        self, found: Mapping[str, list[FrameReceived[Any] | Damaged]]
    ) -> list[FrameReceived[Any] | Damaged]:
        for name, events in found.items():
            for at, event in enumerate(events):
                if isinstance(event, FrameReceived) and self._relays[name].shows(event.frame):
                    self.hopeless = self._count - len(event.raw) > MOST_GARBAGE
                    if self.hopeless:
                        return []
                    self.protocol = name
                    return events[at:]
        self.hopeless = self._count > 2 * MOST_GARBAGE
        return []
