"""What `multidrop scan` does: listens, then sweeps protocol after protocol, setting after setting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from multidrop.errors import DeviceError, NoReply, ProtocolError
from multidrop.io.line import Line, Tap
from multidrop.io.ports import Port, PortSetup, open_port
from multidrop.naming import LineOptions
from multidrop.probing import Identity
from multidrop.tools.ears import Ear
from multidrop.tools.scan.listening import Listening
from multidrop.tools.scan.plan import FIXED, Round, rounds
from multidrop.tools.scan.result import FoundDevice, State, Traffic
from multidrop.tools.scan.sweep import Counted, Found, Sweep

MachineT = TypeVar("MachineT", Sweep, Listening)


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a scan is, in addresses."""

    round: Round
    asked: int
    total: int
    devices: int


class Scanner:
    """Carries out a scan. After `run`, or while it is broken off, `state` says how to go on.

    `watch` gives the taps of a round; `tell` is called after each probe.
    """

    def __init__(
        self,
        port: str,
        options: LineOptions,
        state: State,
        *,
        watch: Callable[[Round], list[Tap]] = lambda round: [],
        tell: Callable[[Progress], None] = lambda progress: None,
        open_port: Callable[[str, PortSetup], Port] = open_port,
    ) -> None:
        self.state = state
        self.rounds = rounds(state.wanted, port)
        self.counted = Counted()
        self.traffic: Traffic | None = None
        self._url = port
        self._options = options
        self._watch = watch
        self.tell = tell
        self._open_port = open_port
        self._port: Port | None = None
        self._opened: tuple[int, str] | None = None
        self._watched: Round | None = None
        self._taps: list[Tap] = []

    @property
    def at(self) -> str:
        """Where the scan is, for a person."""
        left = self.state.left
        address = f", address {left[0]}" if left else ""
        return f"{self.rounds[min(self.state.number, len(self.rounds) - 1)]}{address}"

    def run(self) -> list[FoundDevice]:
        """Everything that was found; `traffic` is set where somebody else spoke and it ended early."""
        state = self.state
        try:
            self.traffic = self._listen()
            while self.traffic is None and state.number < len(self.rounds):
                self._sweep(self.rounds[state.number])
                if self.traffic is None:
                    state.number, state.left, state.found = state.number + 1, None, {}
                if state.wanted.first and any(not item.error for item in state.devices):
                    break
            return state.devices
        finally:
            if self._port is not None:
                self._port.close()

    # -- listening -------------------------------------------------------------------------

    def _listen(self) -> Traffic | None:
        """What is heard at the first setting; at the others only where that cannot be understood."""
        wanted = self.state.wanted
        if wanted.anyway or not wanted.listen:
            return None
        first: Traffic | None = None
        here = self.rounds[min(self.state.number, len(self.rounds) - 1) :]
        for baud, form in dict.fromkeys((item.baud, item.format) for item in here):
            at_this = [item for item in here if (item.baud, item.format) == (baud, form)]
            port = self._open(at_this[0])
            listening = Listening(
                {item.protocol: Ear(item.module, item.module.decoder()) for item in at_this},
                wanted.listen,
            )
            self._run(listening, port)
            if not listening.speaking:
                return first
            protocol = listening.understood
            heard = listening.heard[protocol] if protocol is not None else None
            first = Traffic(
                baud,
                form,
                protocol,
                listening.size,
                wanted.listen,
                tuple(heard.lines) if heard else (),
                tuple(sorted(heard.addresses)) if heard else (),
            )
            if protocol is not None or self._url.startswith(FIXED):
                break
        return first

    # -- sweeping --------------------------------------------------------------------------

    def _sweep(self, round: Round) -> None:
        state = self.state
        port = self._open(round)
        module, settings = round.module, round.settings
        sweep = Sweep(
            module,
            module.decoder(),
            settings.timing(network=port.network),
            round.addresses if state.left is None else state.left,
            state.wanted.wait,
            anyway=state.wanted.anyway,
            found=state.found,
        )
        state.found = sweep.found
        self._run(sweep, port, lambda: self._note(round, sweep))
        self._count(sweep.counted)
        if sweep.foreign is not None:
            self.traffic = Traffic(
                round.baud, round.format, round.protocol, lines=(sweep.foreign,), between=True
            )
            return
        line = Line(port, settings, self._options)
        line.taps.extend(self._taps)
        known = {(item.protocol, item.address, item.baud, item.format) for item in state.devices}
        for address in sorted({*sweep.found, *sweep.damaged}):
            where = (round.protocol, address, round.baud, round.format)
            if where not in known:
                found = sweep.found.get(address)
                damage = sweep.damaged.get(address, b"")
                state.devices.append(_device(line, round, address, found, damage))

    def _note(self, round: Round, sweep: Sweep) -> None:
        """After each step: where the scan is."""
        self.state.left = sweep.left
        before = sum(len(item.addresses) for item in self.rounds[: self.state.number])
        total = sum(len(item.addresses) for item in self.rounds)
        asked = before + len(round.addresses) - sweep.waiting
        count = len(self.state.devices) + len(sweep.found)
        self.tell(Progress(round, asked, total, count))

    def _count(self, counted: Counted) -> None:
        self.counted.echoes += counted.echoes
        self.counted.strays += counted.strays
        self.counted.damaged += counted.damaged
        self.counted.noisy |= counted.noisy

    # -- the port --------------------------------------------------------------------------

    def _open(self, round: Round) -> Port:
        """The port at a round's setting; it stays open as long as that stays the same."""
        setting = (round.baud, round.format)
        if self._port is None or (setting != self._opened and not self._url.startswith(FIXED)):
            if self._port is not None:
                self._port.close()
                self._port = None
            self._port = self._open_port(self._url, PortSetup(round.settings, self._options))
        self._opened = setting
        if round != self._watched:
            self._watched, self._taps = round, self._watch(round)
        return self._port

    def _run(self, machine: MachineT, port: Port, after: Callable[[], None] = lambda: None) -> None:
        """Give a machine bytes and time until it is done."""
        to_send = machine.start(port.now())
        while True:
            if to_send:
                port.write(to_send)
                self._show(to_send, port.now(), sent=True)
                after()
            if machine.done:
                break
            data = port.read(machine.deadline - port.now())
            now = port.now()
            marks = port.marks
            pieces = [(data, False)] if marks is None or not data else marks.split(data)
            to_send = b""
            for piece, damaged in pieces:
                if piece:
                    self._show(piece, now, damaged=damaged)
                to_send += machine.advance(piece, now, damaged=damaged)
        after()

    def _show(self, data: bytes, now: float, *, sent: bool = False, damaged: bool = False) -> None:
        for tap in self._taps:
            tap(data, sent, now, damaged)


def _device(
    line: Line, round: Round, address: int, found: Found | None, damage: bytes
) -> FoundDevice:
    """Who it is that answered: asked with the protocol's own times and attempts."""
    if found is None:
        more = " ..." if len(damage) > 16 else ""
        error = (
            f"something answers at {address}, damaged ({damage[:16].hex(' ').upper()}{more}): "
            "two devices with this address, or another format?"
        )
        return FoundDevice(round.protocol, None, address, round.baud, round.format, error=error)
    try:
        identity = line.run(round.module.prober.identify(address))
    except (DeviceError, NoReply, ProtocolError) as error:
        identity = Identity(round.protocol, note=f"{found.said}; then {error}")
    return FoundDevice(
        protocol=round.protocol,
        profile=identity.profile,
        address=address,
        baud=round.baud,
        format=round.format,
        ms=found.ms,
        behind=identity.behind,
        note="; ".join(filter(None, (identity.note, found.doubt))),
    )
