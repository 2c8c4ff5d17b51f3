"""What the slaves of all protocols have in common: bytes in, requests out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from multidrop.decoder import Decoder
from multidrop.events import Damaged, FrameReceived

FrameT = TypeVar("FrameT")
RequestT = TypeVar("RequestT")


class BaseSlave(ABC, Generic[FrameT, RequestT]):
    """The receiving half of a slave. What is asked of it comes out, the rest gets silence."""

    def __init__(self, address: int, decoder: Decoder[FrameT]) -> None:
        self.address = address
        self._decoder = decoder

    def receive_data(self, data: bytes) -> list[RequestT]:
        """Take bytes from the line; returns the requests in them that want an answer or an action."""
        return self.receive_events(self._decoder.receive_data(data))

    def silence(self) -> list[RequestT]:
        """The line fell silent: a frame that was still coming ends here."""
        return self.receive_events(self._decoder.silence())

    def receive_events(self, events: list[FrameReceived[FrameT] | Damaged]) -> list[RequestT]:
        """The same for bytes that one decoder has decoded for all slaves of a line."""
        requests = []
        for event in events:
            if isinstance(event, Damaged):
                request = self._damage(event)
            else:
                request = self._receive(event.frame)
            if request is not None:
                requests.append(request)
        return requests

    @abstractmethod
    def _receive(self, frame: FrameT) -> RequestT | None:
        """What a frame asks of this slave; None for one that is not for it, or gets silence."""

    def _damage(self, event: Damaged) -> RequestT | None:
        """What is answered to damage: as a rule nothing, since the address may be wrong."""
        return None
