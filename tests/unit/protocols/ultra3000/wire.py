"""A scripted drive on a line with a clock of its own: what these tests speak to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from multidrop.conversation import Conversation
from multidrop.exchange import Exchange
from multidrop.protocols.ultra3000 import LINE, Frame
from multidrop.protocols.ultra3000.frame import READS, REFUSED
from multidrop.session import Session

Answer = str | bytes | None
"""Digits of a value, `!05` for a refusal, bytes as they stand on the wire, None for silence."""

PRODUCT = {"0000": "0A000001"}
"""What a drive answers to the read that shows whether the line hears itself."""


class Wire:
    """Answers bodies (`PPPF` and data) as `answers` say; those not named there get silence.

    A list is worked off, its last answer stays. `hears_itself` is what the line
    does, `echo` what the master was told of it. `sent` are the bodies that went
    out, `told` those to another address with it in front.
    """

    def __init__(
        self,
        answers: Mapping[str, Answer | Sequence[Answer]] | None = None,
        *,
        echo: bool | None = False,
        hears_itself: bool = False,
        address: int = 0,
        keeps_time: bool | None = True,
    ) -> None:
        self.answers = {**PRODUCT, **(answers or {})}
        self.session: Session[Frame] = Session(
            LINE.decoder(), LINE.timing(network=False), echo=echo
        )
        self.session.keeps_time = keeps_time
        self.sent: list[str] = []
        self.told: list[str] = []
        self.now = 100.0
        self._address = address
        self._hears_itself = hears_itself

    def run(self, conversation: Conversation[Frame, Any]) -> Any:
        exchange = Exchange(conversation, self.session)
        to_send = exchange.start(self.now)
        while True:
            arrived = b""
            for raw in to_send.split(b"\r")[:-1]:
                self.now += (len(raw) + 1) * LINE.character
                arrived += self._hear(raw + b"\r")
            if exchange.done:
                return exchange.result()
            if not arrived:
                self.now = max(self.now, exchange.deadline)
            to_send = exchange.advance(arrived, self.now)

    def _hear(self, raw: bytes) -> bytes:
        frame = Frame.decode(raw)
        body = f"{frame.parameter:03X}{frame.function:X}{frame.data}"
        echo = raw if self._hears_itself else b""
        if frame.address != self._address:
            self.told.append(f"{frame.address:02X}{body}")
            return echo
        self.sent.append(body)
        answer = self.answers.get(body)
        if isinstance(answer, list):
            answer = answer.pop(0) if len(answer) > 1 else answer[0]
        assert answer is None or isinstance(answer, str | bytes)
        if answer is None or isinstance(answer, bytes):
            return echo + (answer or b"")
        if answer.startswith("!"):
            reply = Frame(frame.address, frame.parameter + REFUSED, frame.function, answer[1:])
        else:
            assert frame.function in READS or not answer
            reply = Frame(frame.address, frame.parameter, frame.function, answer)
        return echo + reply.encode()
