"""A line to examine, in a time of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from multidrop.io.memory import MemoryPort, Peer
from multidrop.io.ports import PortSetup
from multidrop.naming import LineOptions
from multidrop.protocols import PROTOCOLS
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault, ScriptedFaults
from multidrop.sim.line import LineFaults, Pace, SimulatedLine
from multidrop.sim.misread import Setting
from multidrop.tools.doctor.doctor import Case, judge
from multidrop.tools.doctor.examination import Examination, Visit
from multidrop.tools.doctor.verdicts import Verdict, What


def line(
    *devices: tuple[str, int],
    faults: Any = (),
    echo: bool = False,
    late: float = 3.0,
    burst: float = 0.0,
    protocol: str = "slink3",
) -> SimulatedLine:
    """Paced devices; `faults` one an answer."""
    settings = PROTOCOLS[protocol].line
    return SimulatedLine(
        [simulated_device(*device) for device in devices],
        settings.decoder,
        character=settings.character,
        pace=Pace(settings.character, burst, 0.003),
        faults=LineFaults(ScriptedFaults(faults), late, echo),
    )


class Ports:
    """Opens ports on the same wire; `at` makes the peer for a setting."""

    def __init__(self, at: Callable[[Setting], Peer], *, marks: bool = False) -> None:
        self._at = at
        self._marks = marks
        self.sent = bytearray()
        self.opened: list[Setting] = []

    def __call__(self, url: str, setup: PortSetup) -> MemoryPort:
        setting = Setting(setup.settings.baud, setup.settings.format)
        self.opened.append(setting)
        port = MemoryPort(self._at(setting), marks=self._marks)
        write = port.write

        def noted(data: bytes) -> None:
            self.sent += data
            write(data)

        port.write = noted  # type: ignore[method-assign]
        return port


def examined(
    ports: Ports,
    *addresses: int,
    protocol: str = "slink3",
    url: str = "/dev/ttyS9",
    seconds: float = 0.5,
    listen_only: bool = False,
    times: int = 10,
    **settings: Any,
) -> Case:
    module = PROTOCOLS[protocol]
    visit = Visit(module, module.line.with_options(**settings), addresses)
    examination = Examination(
        *(url, LineOptions(), [visit]),
        seconds=seconds,
        listen_only=listen_only,
        times=times,
        open_port=ports,
    )
    return examination.run()


def on(wire: SimulatedLine) -> Ports:
    return Ports(lambda setting: wire.attach())


def verdict(case: Case, what: What) -> Verdict:
    """The verdict of this kind; it must be the first one that is trouble."""
    found = judge(case)
    assert found[0].what is what, found
    return found[0]


def note(case: Case, what: What) -> Verdict:
    """A verdict anywhere."""
    (found,) = [item for item in judge(case) if item.what is what]
    return found


__all__ = ["Fault", "Ports", "examined", "line", "note", "on", "verdict"]
