"""One port for many masters: each believes that it has the line for itself.

Frames of its clients go on the line one at a time, and each client hears the
answers to its own requests only. What may act passes only where that was allowed,
and is recorded in the log of writes. A client that misbehaves harms nobody else.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from multidrop.errors import NoReply, NotApplied, PortError, UsageError
from multidrop.io.audit import AuditLog, shown
from multidrop.io.connection import Target
from multidrop.io.listen import Caller, Listener, listen
from multidrop.io.turns import Priority
from multidrop.protocols import PROTOCOLS
from multidrop.relay import Passage, Recognition
from multidrop.tools.share.client import Client, Counts
from multidrop.tools.share.client_turns import ClientTurns, Hold, Waiting
from multidrop.tools.share.port import SharedPort, Watch, try_port
from multidrop.writing import Outcome

PATIENCE = 1.0
"""s that a frame may wait for the line at least: about as long as a master waits for its answer."""

SILENCE = 1.0
"""s without a byte that cut a client's frame short while its protocol is not known."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened, in one line for a person and as a word for programs."""

    kind: str
    text: str
    client: str | None = None


@dataclass(frozen=True, slots=True)
class Rules:
    """Who may do what. `protocol` is the only one, where that is known from the start."""

    audit: AuditLog
    allow_writes: bool = False
    protocol: str | None = None


class Share:
    """A port, its clients, and whose turn it is."""

    def __init__(
        self,
        targets: Mapping[str, Target],
        rules: Rules,
        tell: Callable[[Event], None],
        watch: Watch = lambda taps, target: None,
    ) -> None:
        self.counts = Counts()
        self.silence = SILENCE
        self._targets = targets
        self._rules = rules
        self._tell = tell
        self._relays = {
            name: target.protocol.relay(target.options.own) for name, target in targets.items()
        }
        self._clients: set[Client] = set()
        self._turns: ClientTurns[Client] = ClientTurns(PATIENCE)
        self._port = SharedPort(lambda kind, text: tell(Event(kind, text)), watch, self._lost)
        self._arrived = asyncio.Event()
        self._protocol: str | None = None
        self._loop = asyncio.get_running_loop()

    async def run(self, where: str, ready: Callable[[Listener], None]) -> None:
        """Serve until cancelled; `ready` is called once programs can connect.

        Raises `UsageError` for an address or a log that cannot be used, `PortError`
        where it cannot listen, or the port cannot be opened.
        """
        if self._rules.allow_writes:
            self._rules.audit.check()
        serving = asyncio.gather(self._port.keep_open(), self._serve(), self._say_if_closed())
        listener = None
        try:
            if self._rules.protocol is not None:
                self._speak(self._rules.protocol)
                opening = asyncio.ensure_future(self._port.first_try())
                await asyncio.wait((serving, opening), return_when=asyncio.FIRST_COMPLETED)
                if serving.done():
                    opening.cancel()
                    await serving
                await opening
            else:
                await try_port(next(iter(self._targets.values())))
            listener = await listen(where, self._answer)
            ready(listener)
            await serving
        finally:
            if listener is not None:
                listener.close()
            for client in list(self._clients):
                client.hang_up()
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)

    async def _say_if_closed(self) -> None:
        """Where the first client that speaks finds no port."""
        try:
            await self._port.first_try()
        except PortError as error:
            self._tell(Event("port-closed", f"{error}; trying again"))

    def _lost(self) -> None:
        """What waits is not sent later: its masters have given it up by then."""
        self._turns.clear()
        for client in self._clients:
            client.pause(False)

    # -- clients ---------------------------------------------------------------------------

    def _answer(self, caller: Caller) -> Client:
        decoders = {name: target.settings.decoder() for name, target in self._targets.items()}
        client = Client(self, caller, Recognition(decoders, self._relays))
        self._clients.add(client)
        self._turns.join(client)
        self.counts.clients += 1
        self._tell(Event("client-come", f"{client.name} came", client.name))
        return client

    def left(self, client: Client) -> None:
        self._clients.discard(client)
        self._turns.leave(client, self._loop.time())
        self._arrived.set()
        counts = client.counts
        self._tell(Event("client-gone", f"{client.name} went: {counts.shown()}", client.name))

    def hang_up(self, client: Client, why: str) -> None:
        self._tell(Event("client-refused", f"{client.name} {why}: disconnected", client.name))
        client.hang_up()

    def put(self, client: Client, frame: Any) -> None:
        assert client.protocol is not None
        if self._protocol is None:
            self._speak(client.protocol)
        if client.protocol != self._protocol:
            self.hang_up(client, f"speaks {client.protocol}, and the line {self._protocol}")
            return
        if self._port.away:
            self._drop(client)
            return
        passage = self._relays[self._protocol].passage(frame, None)
        once = isinstance(passage, Passage) and passage.answered
        if not self._turns.put(client, frame, self._loop.time(), once=once):
            self._drop(client)
            client.pause(True)
        self._arrived.set()

    def _drop(self, client: Client) -> None:
        self.counts.dropped += 1
        client.counts.dropped += 1

    def _speak(self, name: str) -> None:
        self._protocol = name
        timing = self._targets[name].settings.timing(network=True)
        self.silence = timing.silence
        self._turns.patience = max(PATIENCE, timing.answer)
        self._port.settle(self._targets[name])

    # -- the line --------------------------------------------------------------------------

    async def _serve(self) -> None:
        """Frame by frame, and what is to be said when a client does not finish."""
        while True:
            await self._port.open.wait()
            hold = self._turns.hold
            if hold is not None and self._loop.time() >= hold.until:
                self._turns.hold = None
                await self._let_go(hold.frame)
                continue
            turn = self._turns.take(self._loop.time())
            if turn is not None:
                await self._serve_one(turn)
                if not self._turns_left(turn.client):
                    turn.client.pause(False)
                continue
            self._arrived.clear()
            try:
                async with asyncio.timeout_at(hold.until if hold is not None else None):
                    await self._arrived.wait()
            except TimeoutError:
                continue

    def _turns_left(self, client: Client) -> bool:
        return not client.gone and self._turns.waiting(client) > 0

    async def _let_go(self, frame: Any) -> None:
        assert self._protocol is not None
        relay = self._relays[self._protocol]
        with contextlib.suppress(PortError):
            await self._port.line.run(relay.let_go(frame), Priority.WRITE)

    async def _serve_one(self, turn: Waiting[Client]) -> None:
        client, frame = turn.client, turn.frame
        assert self._protocol is not None
        hold = self._turns.hold
        held = hold.frame if hold is not None else None
        passage = self._relays[self._protocol].passage(frame, held)
        if isinstance(passage, str):
            self._not_passed(
                client, "not-passed", f"{self._described(frame)} not passed: {passage}"
            )
        elif passage.acts and (why := self._why_not()):
            client.counts.refused += 1
            self.counts.refused += 1
            if passage.refusal is not None:
                client.write(passage.refusal.encode())
            self._not_passed(
                client, "write-refused", f"write refused: {self._described(frame)} ({why})"
            )
        else:
            await self._pass(client, frame, held, passage)
            return
        await asyncio.sleep(0)  # a flood of these keeps nobody else waiting

    def _not_passed(self, client: Client, kind: str, text: str) -> None:
        if client.may_be_told_of():
            self._tell(Event(kind, f"{client.name} {text}", client.name))

    def _why_not(self) -> str:
        """Why nothing may act now; empty where it may."""
        if not self._rules.allow_writes:
            return "reads only; --allow-writes lets it pass"
        try:
            self._rules.audit.check()
        except UsageError as error:
            return str(error)
        return ""

    async def _pass(self, client: Client, frame: Any, held: Any, passage: Passage[Any]) -> None:
        """Say it on the line, and tell its client the answer."""
        assert self._protocol is not None
        line, relay = self._port.line, self._relays[self._protocol]
        for counts in (self.counts, client.counts):
            counts.requests += 1
        outcome, answer = Outcome.UNKNOWN, None
        try:
            answer = await line.run(
                relay.carry(frame, held),
                Priority.WRITE if passage.acts else Priority.OPERATOR,
                client.name,
            )
            outcome = relay.outcome(answer)
        except NoReply:
            pass  # the client's own time-out tells it
        except NotApplied as late:
            self._not_passed(client, "not-passed", f"{self._described(frame)} not passed: {late}")
        except PortError:
            pass  # the port says so itself
        finally:
            if answer is not None:
                client.write(answer.encode())
            if passage.written is not None and line.acted:
                self._record(client, passage.written, answer, outcome)
        if answer is not None:
            for counts in (self.counts, client.counts):
                counts.answers += 1
        self._hold(client, frame, passage, answered=answer is not None)

    def _hold(self, client: Client, frame: Any, passage: Passage[Any], *, answered: bool) -> None:
        """The line stays with this client for as long as its frame wants it, or is free."""
        if passage.hold is None:
            return
        self._turns.hold = None
        if passage.hold and (answered or not passage.answered):
            until = self._loop.time() + (0.0 if client.gone else passage.hold)
            self._turns.hold = Hold(client, frame, until)

    def _described(self, frame: Any) -> str:
        assert self._protocol is not None
        return PROTOCOLS[self._protocol].describe(frame)

    def _record(self, client: Client, written: Any, answer: Any, outcome: Outcome) -> None:
        """A line in the log of writes for each point, or for what is none."""
        assert self._protocol is not None
        target = self._targets[self._protocol]
        meaning = target.protocol.explain([written], target.profile)
        asked = [(point.text, shown(sample, point.description)) for point, sample in meaning.values]
        facts = {} if answer is None else {"answer": self._described(answer)}
        try:
            for point, value in asked or [(self._described(written), None)]:
                self._rules.audit.append(
                    f"{self._protocol}:{written.address}@{target.port}",
                    point,
                    who=client.name,
                    asked=value,
                    outcome=outcome.value,
                    frame=written.encode().hex(),
                    **facts,
                )
        except OSError as error:  # it could be written just before
            text = f"{client.name} wrote, and the log of writes was lost: {error}"
            self._tell(Event("audit-failed", text, client.name))
