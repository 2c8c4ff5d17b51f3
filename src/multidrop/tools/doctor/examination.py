"""What `multidrop doctor` does at a port: listens, then reads. It never speaks over a master that is there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from multidrop.device import ProtocolModule
from multidrop.io.line import Tap
from multidrop.io.list_ports import latency_of
from multidrop.io.ports import Port, PortSetup, open_port
from multidrop.naming import LineOptions
from multidrop.protocols import PROTOCOLS
from multidrop.sim.misread import Setting
from multidrop.timing import Format, LineSettings
from multidrop.tools.doctor.answered import FIXED
from multidrop.tools.doctor.asking import TIMES, Asking
from multidrop.tools.doctor.doctor import Case
from multidrop.tools.doctor.evidence import GLITCH, Evidence, Piece, examine
from multidrop.tools.doctor.judging_traffic import other_format
from multidrop.tools.doctor.likely_settings import Candidate, likely

POLL = 0.2
"""s without a byte after which the progress is told."""
ELSEWHERE = 1.0
"""s that each other setting is listened to."""
MOST_BAUDS, MOST_FORMATS = 10, 2
"""Other baud rates that are listened to, the likeliest first, and candidates of 7 bits at each."""


@dataclass(frozen=True, slots=True)
class Visit:
    """A protocol at one setting, and whom to ask there."""

    module: ProtocolModule
    settings: LineSettings
    addresses: tuple[int, ...]

    @property
    def setting(self) -> Setting:
        return Setting(self.settings.baud, self.settings.format)

    def __str__(self) -> str:
        return f"{self.module.name} {self.setting}"


class Examination:
    """Carries it out. `tell` is called with what is being done; `watch` gives the taps of a visit."""

    def __init__(
        self,
        port: str,
        options: LineOptions,
        visits: Sequence[Visit],
        *,
        seconds: float,
        listen_only: bool = False,
        times: int = TIMES,
        watch: Callable[[Visit], list[Tap]] = lambda visit: [],
        tell: Callable[[str], None] = lambda text: None,
        open_port: Callable[[str, PortSetup], Port] = open_port,
    ) -> None:
        self._url = port
        self._options = replace(options, rts="leave", dtr="leave") if listen_only else options
        self._visits = list(visits)
        self._seconds = seconds
        self._listen_only = listen_only
        self._times = times
        self._watch = watch
        self._tell = tell
        self._open_port = open_port
        self._port: Port | None = None
        self._opened: Setting | None = None
        self._visited: Visit | None = None
        self._taps: list[Tap] = []
        self._latency_ms = None if "://" in port else latency_of(port)

    def run(self) -> Case:
        """All that was found out. Raises `PortError`."""
        try:
            first = self._visits[0]
            heard = self._listen(first, self._seconds)
            here = [visit for visit in self._visits if visit.setting == first.setting]
            listened = [self._evidence(visit, heard, self._seconds) for visit in here]
            known = [evidence for evidence in listened if evidence.understood]
            if known or self._listen_only or _size(heard) > GLITCH:
                return self._of_traffic(known or listened[:1], heard, first)
            return Case(tuple(self._ask_all(heard)))
        finally:
            if self._port is not None:
                self._port.close()

    # -- listening -------------------------------------------------------------------------

    def _of_traffic(self, listened: list[Evidence], heard: tuple[Piece, ...], first: Visit) -> Case:
        """Somebody speaks, or nothing shall be asked."""
        if _size(heard) <= GLITCH or listened[0].understood:
            return Case(tuple(listened[:1]), self._listen_only)
        candidates = likely(b"".join(piece.data for piece in heard), first.setting)
        elsewhere = None
        if not self._url.startswith(FIXED):
            elsewhere = self._listen_elsewhere(candidates, first)
        return Case(tuple(listened), self._listen_only, tuple(candidates), elsewhere)

    def _listen_elsewhere(self, candidates: list[Candidate], first: Visit) -> Evidence | None:
        """The setting at which it is understood, if it is one of the likely ones."""
        wrong: Evidence | None = None  # at the right baud rate, in another format
        for setting in _settings(candidates):
            again = setting.format in _OTHER_PARITIES  # of use only where the rate is right
            known = wrong is not None and wrong.settings.baud == setting.baud
            if setting == first.setting or (again and not known):
                continue
            evidence = self._understood_at(setting)
            if evidence is None:
                continue
            if not other_format(examine(evidence.heard, evidence.protocol, evidence.settings)):
                return evidence
            wrong = evidence
        return wrong

    def _understood_at(self, setting: Setting) -> Evidence | None:
        visits = [
            Visit(protocol, protocol.line.with_options(**setting._asdict()), ())
            for protocol in PROTOCOLS.values()
        ]
        heard = self._listen(visits[0], ELSEWHERE)
        listened = [self._evidence(visit, heard, ELSEWHERE) for visit in visits]
        return next((evidence for evidence in listened if evidence.understood), None)

    def _listen(self, visit: Visit, seconds: float) -> tuple[Piece, ...]:
        """What comes within so many seconds; of one who only listens, until Ctrl-C too."""
        port, taps = self._open(visit)
        heard: list[Piece] = []
        until = port.now() + seconds
        try:
            while (left := until - port.now()) > 0:
                what = f"listening at {visit.setting}"
                self._tell(f"{what}, {left:.0f} s more, {_size(heard)} bytes so far")
                heard += _read(port, min(left, POLL), taps)
        except KeyboardInterrupt:
            if not (self._listen_only and heard):
                raise
        return tuple(heard)

    # -- asking ----------------------------------------------------------------------------

    def _ask_all(self, heard: tuple[Piece, ...]) -> Iterator[Evidence]:
        """Each visit, until somebody answers or another master speaks."""
        for visit in self._visits:
            asking = self._ask(visit)
            evidence = self._evidence(visit, heard, self._seconds)
            yield replace(evidence, asked=tuple(asking.asked))
            heard = ()
            if asking.foreign is not None or asking.answers:
                return

    def _ask(self, visit: Visit) -> Asking:
        port, taps = self._open(visit)
        asking = Asking(
            *(visit.module, visit.settings, visit.addresses),
            network=port.network,
            times=self._times,
        )
        to_send = asking.start(port.now())
        while True:
            if to_send:
                port.write(to_send)
                self._tell(f"{visit}: {asking.where}")
                for tap in taps:
                    tap(to_send, True, port.now(), False)
            if asking.done:
                return asking
            pieces = _read(port, asking.deadline - port.now(), taps)
            now = port.now()
            to_send = b"".join(
                asking.advance(data, now, damaged=damaged)
                for data, _, damaged in pieces or [Piece(b"", now, False)]
            )

    # -- the port --------------------------------------------------------------------------

    def _evidence(self, visit: Visit, heard: tuple[Piece, ...], seconds: float) -> Evidence:
        assert self._port is not None
        return Evidence(
            *(self._url, visit.module, visit.settings, self._port.network, seconds),
            heard=heard,
            latency_ms=self._latency_ms,
        )

    def _open(self, visit: Visit) -> tuple[Port, list[Tap]]:
        """The port at a visit's setting, which stays open as long as that stays the same; its taps."""
        if self._port is None or (
            visit.setting != self._opened and not self._url.startswith(FIXED)
        ):
            if self._port is not None:
                self._port.close()
                self._port = None
            self._port = self._open_port(self._url, PortSetup(visit.settings, self._options))
        self._opened = visit.setting
        if visit is not self._visited:
            self._visited, self._taps = visit, self._watch(visit)
        return self._port, self._taps


def _read(port: Port, timeout: float, taps: list[Tap]) -> list[Piece]:
    """What arrives within `timeout` s, without the port's marks."""
    data = port.read(timeout)
    if not data:
        return []
    now, marks = port.now(), port.marks
    pieces = [(data, False)] if marks is None else marks.split(data)
    for piece, damaged in pieces:
        for tap in taps:
            tap(piece, False, now, damaged)
    return [Piece(piece, now, damaged) for piece, damaged in pieces]


_OTHER_PARITIES = (Format(8, "O", 1), Format(8, "N", 1))  # without parity nothing is marked: last


def _settings(candidates: list[Candidate]) -> list[Setting]:
    """Where to listen: the likeliest baud rates first, and at each first with parity.

    A port that expects parity marks a line that has none, or another one; not the other way round.
    """
    found: list[Setting] = []
    bauds = list(dict.fromkeys(item.setting.baud for item in candidates))
    for baud in bauds[:MOST_BAUDS]:
        likely = [item.setting for item in candidates if item.setting.baud == baud]
        seven = [item for item in likely[:MOST_FORMATS] if item.format.data_bits == 7]
        found += [Setting(baud, form) for form in (Format(8, "E", 1), *_OTHER_PARITIES)] + seven
    return list(dict.fromkeys(found))


def _size(pieces: Sequence[Piece]) -> int:
    return sum(len(piece.data) for piece in pieces)


__all__ = ["Examination", "Visit"]
