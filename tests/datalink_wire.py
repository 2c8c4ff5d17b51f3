"""What the tests of Datalink's host side speak to: a script of answers, or an instrument with memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from multidrop.conversation import Ask, Conversation, Tell, TooLate, Wait
from multidrop.exchange import Exchange
from multidrop.protocols.datalink import LINE, LINE_WITHOUT_STUFFING, Command, Frame, Slave
from multidrop.protocols.datalink.slave import Reply, Request
from multidrop.session import Session

Step = Ask[Frame] | Tell[Frame] | Wait


def response(memory_address: int, data: str, address: int = 3) -> Frame:
    """A Response with these data, in hex."""
    raw = bytes.fromhex(data)
    return Frame(Command.RESPONSE, address, memory_address, len(raw), raw)


def steps_of(
    conversation: Conversation[Frame, Any], *answers: Frame | Exception
) -> tuple[list[Step], Any]:
    """The steps and the result of a conversation whose `Ask`s are answered in turn.

    An exception is thrown into it; `TooLate` is the answer of a `Tell` that was not sent.
    """
    steps: list[Step] = []
    waiting = list(answers)
    try:
        step = next(conversation)
        while True:
            steps.append(step)
            answer: Any = None
            late = isinstance(step, Tell) and waiting and isinstance(waiting[0], TooLate)
            if isinstance(step, Ask) or late:
                answer = waiting.pop(0)
            step = (
                conversation.throw(answer)
                if isinstance(answer, Exception)
                else conversation.send(answer)
            )
    except StopIteration as stop:
        assert not waiting, waiting
        return steps, stop.value


class Instrument:
    """A slave with 64 KiB of memory; what is acknowledged is applied `scans` looks later."""

    def __init__(self, address: int = 3, *, stuffing: bool = True, scans: int = 0) -> None:
        self.slave = Slave(address, stuffing=stuffing)
        self.memory = bytearray(0x10000)
        self.memory[0x8002] = 6
        self.requests: list[Request] = []
        self.alter: Callable[[Request, bytes], bytes] = lambda request, answer: answer
        """Last say in what goes back for a request; no bytes for silence."""
        self._line = LINE if stuffing else LINE_WITHOUT_STUFFING
        self._scans = scans
        self._applies: list[tuple[int, Request]] = []

    def receive(self, data: bytes) -> bytes:
        out = b""
        for request in self.slave.receive_data(data):
            self.requests.append(request)
            out += self.alter(request, self._answer(request))
        return out

    def _answer(self, request: Request) -> bytes:
        where = slice(request.memory_address, request.memory_address + request.count)
        if request.acknowledged:
            self._applies.append((self._scans, request))
        elif request.settled is None:
            self._applies = [(scans - 1, change) for scans, change in self._applies]
        for _, change in [item for item in self._applies if item[0] <= 0]:
            at = slice(change.memory_address, change.memory_address + change.count)
            self.memory[at] = change.changed(bytes(self.memory[at]))
        self._applies = [item for item in self._applies if item[0] > 0]
        return self.slave.answer(request, request.settled or Reply(bytes(self.memory[where])))

    def run(self, conversation: Conversation[Frame, Any], now: float = 0.0) -> Any:
        """Carry a conversation out with this instrument at the other end, without waiting."""
        session: Session[Frame] = Session(self._line.decoder(), self._line.timing(network=False))
        exchange = Exchange(conversation, session)
        to_send = exchange.start(now)
        while to_send or not exchange.done:
            answer = self.receive(to_send) if to_send else b""
            if exchange.done:
                break
            now = now + 0.005 if answer else exchange.deadline
            to_send = exchange.advance(answer, now)
        return exchange.result()

    @property
    def messages(self) -> list[Frame]:
        """What it understood, the acknowledged changes left out."""
        return [request.frame for request in self.requests if not request.acknowledged]
