"""`--trace`: every frame that passes, decoded, in the order and with the time it passed."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Any, TextIO

from multidrop.decoder import Decoder
from multidrop.device import ProtocolModule
from multidrop.events import Damaged


class Trace:
    """A tap on a line that writes one line a frame: `>` sent, `<` received, `!` damage."""

    def __init__(
        self, protocol: ProtocolModule, new_decoder: Callable[[], Decoder[Any]], out: TextIO
    ) -> None:
        self._protocol = protocol
        self._new_decoder = new_decoder
        self._out = out
        self._received = new_decoder()
        self._last = 0.0

    def finish(self) -> None:
        """Show what came last and was never followed by anything."""
        self._show(self._received.silence(), "<", self._last)

    def __call__(self, data: bytes, sent: bool, now: float, damaged: bool) -> None:
        if sent:
            self._show(self._received.silence(), "<", now)
            decoder = self._new_decoder()
            self._show(decoder.receive_data(data) + decoder.silence(), ">", now)
        elif damaged:
            self._show(self._received.line_error(data), "<", now)
        else:
            self._show(self._received.receive_data(data), "<", now)

    def _show(self, events: list, arrow: str, now: float) -> None:  # type: ignore[type-arg]
        for event in events:
            clock = datetime.now().strftime("%H:%M:%S.%f")[:-3]
            since = (now - self._last) * 1000 if self._last else 0.0
            self._last = now
            raw = self._protocol.shown(event.raw)
            if isinstance(event, Damaged):
                text = f"! {event.reason}"
            else:
                text = self._protocol.describe(event.frame)
            print(f"{clock} {since:+8.1f} ms {arrow} {raw}  | {text}", file=self._out, flush=True)
