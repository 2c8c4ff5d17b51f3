"""A whole scan of simulated lines, in a time of its own: what is found, said, kept, and never sent."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import PortError, UsageError
from multidrop.events import FrameReceived
from multidrop.io.memory import FOREVER, MemoryPort
from multidrop.io.ports import Port, PortSetup
from multidrop.naming import LineOptions, parse_simulated
from multidrop.plantfile import parse_plant
from multidrop.protocols import PROTOCOLS, datalink
from multidrop.protocols.slink3 import Frame
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault, ScriptedFaults
from multidrop.sim.line import LineFaults, Pace, SimulatedLine
from multidrop.tools.ears import Ear
from multidrop.tools.scan.listening import Listening
from multidrop.tools.scan.plan import Round, Wanted, check_protocols, parse_addresses, rounds
from multidrop.tools.scan.result import FoundDevice, State, StateFile, as_toml
from multidrop.tools.scan.scan import Progress, Scanner
from multidrop.tools.scan.sweep import Found
from multidrop.transaction import Kind
from unit.tools.scan.scanned import Wire

PORT = "/dev/ttyUSB9"
READS: dict[str, Any] = {
    "slink3": lambda frame: not frame.is_answer and frame.code in (0x23, 0x26),
    "datalink": lambda frame: frame.command == 0xE0,
    "ultra3000": lambda frame: frame.function == 0 and not frame.data,
}


class Recording(MemoryPort):
    """A port that keeps what was sent, and may be lost or interrupted after so many writes."""

    def __init__(self, peer: Any, bench: Bench) -> None:
        super().__init__(peer)
        self._bench = bench

    def write(self, data: bytes) -> None:
        self._bench.write(data)
        super().write(data)


class Bench:
    """Devices at one setting of a port. `sent` is everything that went out, by round."""

    def __init__(
        self, *devices: str, at: str = "", echo: bool = False, faults: Sequence[Any] = ()
    ) -> None:
        made = [simulated_device(*parse_simulated(text)) for text in devices]
        protocol = PROTOCOLS[load_profile(devices[0].partition(":")[0]).protocol]
        self.at = at or f"{protocol.line.baud} {protocol.line.format}"
        self.line = SimulatedLine(
            made,
            protocol.decoder,
            pace=Pace(protocol.line.character, answer_delay=0.005),
            faults=LineFaults(ScriptedFaults(list(faults)), 0.5, echo),
        )
        self.opened: list[str] = []
        self.sent: list[tuple[Round, bytes]] = []
        self.progress: list[Progress] = []
        self.after: dict[int, BaseException] = {}  # so many writes
        self._round: Round | None = None

    def open(self, url: str, setup: PortSetup) -> Port:
        assert url == PORT
        setting = f"{setup.settings.baud} {setup.settings.format}"
        self.opened.append(setting)
        return Recording((self.line if setting == self.at else Silent()).attach(), self)

    def write(self, data: bytes) -> None:
        assert self._round is not None
        if len(self.sent) in self.after:
            raise self.after.pop(len(self.sent))
        self.sent.append((self._round, data))

    def watch(self, round: Round) -> list[Any]:
        self._round = round
        return []

    def scanner(self, state: State) -> Scanner:
        return Scanner(
            PORT,
            LineOptions(),
            state,
            watch=self.watch,
            tell=self.progress.append,
            open_port=self.open,
        )

    def scan(self, **wanted: Any) -> list[FoundDevice]:
        return self.scanner(State(Wanted(**wanted))).run()

    def frames(self) -> list[tuple[str, Any]]:
        """Everything that was sent, decoded: each write is one whole frame."""
        found = []
        for item, data in self.sent:
            (event,) = item.module.decoder().receive_data(data)
            assert isinstance(event, FrameReceived)
            found.append((item.protocol, event.frame))
        return found


class Silent:
    """A line at whose setting nobody answers."""

    deadline = FOREVER

    def attach(self) -> Silent:
        return self

    def receive(self, data: bytes, now: float) -> None:
        pass

    def send(self, now: float) -> bytes:
        return b""


def names(devices: list[FoundDevice]) -> list[str]:
    return [f"{item.profile}:{item.address}" for item in devices]


LINES = [
    (("flexmax:0+dgfc386", "ax-v:2", "dgfc386:77+flexmax"), ["flexmax:0", "ax-v:2", "dgfc386:77"]),
    (("53mc5000:3", "53sl6000:31"), ["53mc5000:3", "53sl6000:31"]),
    (("ultra3000:0", "ultra3000:253"), ["ultra3000:0", "ultra3000:253"]),
]


@pytest.mark.parametrize("echo", [False, True], ids=["", "echo"])
@pytest.mark.parametrize(("devices", "expected"), LINES)
def test_everything_is_found_with_nothing_but_reads(
    devices: tuple[str, ...], expected: list[str], echo: bool
) -> None:
    bench = Bench(*devices, echo=echo)
    found = bench.scan()
    assert names(found) == expected
    assert not any(item.error for item in found)
    assert {f"{item.baud} {item.format}" for item in found} == {bench.at}
    assert bench.opened == ["9600 8E1", "38400 8N1"]
    asked = bench.frames()
    assert {name for name, _ in asked} == set(READS)
    profiles = {name: load_profile(name) for name in READS}
    for name, frame in asked:
        assert READS[name](frame), (name, frame)
        kind = PROTOCOLS[name].explain([frame], profiles[name]).kind
        assert kind in (Kind.READ, Kind.STATUS), (name, frame)


@pytest.mark.parametrize(("devices", "expected"), LINES)
def test_the_devices_are_as_before(devices: tuple[str, ...], expected: list[str]) -> None:
    """What stands in the simulated devices is the same after a scan, at every setting, as before."""
    bench = Bench(*devices)
    before = [_contents(device) for device in bench.line.devices]
    bench.scan(wait=1.5)
    assert [_contents(device) for device in bench.line.devices] == before


def _contents(device: Any) -> Any:
    if hasattr(device, "inside"):
        memory = device.inside.memory
        return [memory.raw[memory.map.locate("A", number)] for number in (0, 1, 2)]
    if isinstance(device.parameters, dict):
        return {key: (item.working, item.saved) for key, item in device.parameters.items()}
    return {key: item.value for key, item in device.parameters.known.items()}


def test_what_is_behind_and_what_is_said() -> None:
    drive, ax, card = Bench(*LINES[0][0]).scan(protocols=("slink3",))
    assert (drive.behind, ax.behind, card.behind) == ("dgfc386", None, "flexmax")
    assert drive.ms == pytest.approx(5, abs=0.2)
    (instrument,) = Bench("53mc5000:3").scan(protocols=("datalink",))
    assert instrument.note == "model number '53MC5000', tag 'SIMULATED'"


def test_all_settings_until_the_first() -> None:
    bench = Bench("ultra3000:1", at="9600 7E1")
    (found,) = bench.scan(
        protocols=("ultra3000",), addresses=(0, 1, 2), all_settings=True, first=True
    )
    assert (found.baud, found.format) == (9600, "7E1")
    assert bench.opened[0] == "38400 8N1"
    assert bench.opened[-1] == "9600 7E1"
    assert "4800 8N1" not in bench.opened


def test_two_devices_with_one_address() -> None:
    bench = Bench("ax-v:4", faults=[Fault.WRONG_CHECKSUM] * 9)
    (found,) = bench.scan(protocols=("slink3",))
    assert found.profile is None
    assert found.error.startswith("something answers at 4, damaged (01 04")
    assert "two devices with this address" in found.error


def test_late_answers() -> None:
    bench = Bench("ax-v:4", "ax-v:90", faults=[Fault.LATE_ANSWER, Fault.LATE_ANSWER])
    assert names(bench.scan(protocols=("slink3",))) == ["ax-v:4", "ax-v:90"]


def test_who_answers_the_probe_and_then_no_more() -> None:
    bench = Bench("ax-v:4", faults=[None, *[Fault.NO_ANSWER] * 9])
    (found,) = bench.scan(protocols=("slink3",))
    assert found.profile == "slink3"
    assert found.note.startswith("4 #0 unknown command; then no reply in 3 attempts")


# -- another master --------------------------------------------------------------------------

POLL = PROTOCOLS["slink3"].prober.probe(11).numbered(3).encode()
ANSWER = bytes.fromhex("01 0B 0C 08 01 00 00 0E")


def listened(*unasked: tuple[float, bytes], at: str = "9600 8E1", **wanted: Any) -> Scanner:
    bench = Bench("ax-v:1", at=at)
    opened: list[str] = []

    def open_port(url: str, setup: PortSetup) -> Port:
        opened.append(f"{setup.settings.baud} {setup.settings.format}")
        heard = (
            unasked if opened[-1] == at else [(when, b"\x00\xfc\x81\x33") for when, _ in unasked]
        )
        return Recording(Wire("slink3", unasked=heard), bench)

    scanner = Scanner(PORT, LineOptions(), State(Wanted(**wanted)), open_port=open_port)
    bench.watch(scanner.rounds[0])
    scanner.run()
    assert scanner.traffic is None or scanner.traffic.between or not bench.sent
    return scanner


def test_a_master_that_is_heard_first_is_not_spoken_over() -> None:
    traffic = listened((0.5, POLL), (0.53, ANSWER), (1.5, POLL)).traffic
    assert traffic is not None
    assert (traffic.protocol, traffic.baud, traffic.format) == ("slink3", 9600, "8E1")
    assert traffic.addresses == (11,)
    assert traffic.lines[0] == "01 0B 0C 08 00 23 00 2C  | 11 #3 status word"
    assert len(traffic.lines) == 3
    assert traffic.size == 24


def test_a_master_at_another_setting_is_looked_for() -> None:
    traffic = listened((0.5, POLL), at="19200 8E1", bauds=(9600, 19200, 4800)).traffic
    assert traffic is not None
    assert (traffic.protocol, traffic.baud) == ("slink3", 19200)


def test_a_master_that_nobody_understands() -> None:
    traffic = listened((0.5, POLL), at="300 8E1").traffic
    assert traffic is not None
    assert traffic.protocol is None
    assert traffic.size == 4


def test_of_two_protocols_that_one_which_explains_more() -> None:
    """Data of SLINK3 that read as short Datalink messages."""
    frame = Frame(11, 0, 0, 0xABCD, bytes.fromhex("7E85 7E85 7E85")).encode()
    traffic = listened((0.5, frame)).traffic
    assert traffic is not None
    assert traffic.protocol == "slink3"
    assert len(traffic.lines) == 1


def test_a_glitch_is_no_master() -> None:
    assert listened((0.001, b"\xff\x00"), addresses=(1,), protocols=("slink3",)).traffic is None


def test_a_master_that_comes_later() -> None:
    scanner = listened((4.0, POLL), protocols=("slink3",))
    assert scanner.traffic is not None
    assert scanner.traffic.between
    assert scanner.traffic.lines == ("11 #3 status word",)
    assert scanner.state.left
    assert scanner.state.left[-1] == 127


def test_anyway() -> None:
    scanner = listened((0.5, POLL), (0.9, POLL), protocols=("slink3",), anyway=True)
    assert scanner.traffic is None
    assert scanner.counted.strays == 2


# -- going on --------------------------------------------------------------------------------


@pytest.mark.parametrize("why", [KeyboardInterrupt(), PortError("lost")], ids=["ctrl-c", "lost"])
@pytest.mark.parametrize("after", [3, 60, 128, 131, 150, 170, 400])
def test_a_scan_goes_on_where_it_was(after: int, why: BaseException, tmp_path: Path) -> None:
    devices = LINES[0][0]
    whole = Bench(*devices).scan()
    bench = Bench(*devices)
    bench.after[after] = why
    scanner = bench.scanner(State(Wanted()))
    kept = StateFile(PORT, tmp_path / "state.json")
    with pytest.raises(type(why)):
        scanner.run()
    kept.keep(scanner.state)

    again = Bench(*devices)
    state = kept.load()
    assert state is not None
    found = again.scanner(state).run()
    assert names(found) == names(whole)
    assert [item.behind for item in found] == [item.behind for item in whole]
    probes = {name: len(PROTOCOLS[name].prober.addresses) for name in PROTOCOLS}
    assert len(again.sent) < sum(probes.values()) + 60 - max(0, after - 40)


def test_where_it_is() -> None:
    bench = Bench("ax-v:1")
    bench.after[40] = KeyboardInterrupt()
    scanner = bench.scanner(State(Wanted()))
    assert scanner.at == "slink3 9600 8E1"
    with pytest.raises(KeyboardInterrupt):
        scanner.run()
    assert scanner.at.startswith("slink3 9600 8E1, address 2")
    last = bench.progress[-1]
    assert (last.total, last.devices) == (128 + 32 + 254, 1)
    assert 38 <= last.asked <= 41
    assert [item.asked for item in bench.progress] == sorted(item.asked for item in bench.progress)


def test_the_state_file(tmp_path: Path) -> None:
    path = tmp_path / "below" / "state.json"
    kept = StateFile(PORT, path)
    assert kept.load() is None
    device = FoundDevice("slink3", "ax-v", 2, 9600, "8E1", 3.5)
    state = State(Wanted(bauds=(9600,)), 1, [5, 6], {4: Found(1.5, "said")}, [device])
    kept.keep(state, 10.0)
    assert kept.load() == state
    kept.keep(State(Wanted()), 10.5)  # within a second
    assert kept.load() == state
    kept.keep(State(Wanted()), 11.5)
    assert kept.load() == State(Wanted())
    with pytest.raises(UsageError, match="is of a scan of /dev/ttyUSB9"):
        StateFile("COM1", path).load()
    kept.remove()
    kept.remove()
    assert kept.load() is None


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"port": "/dev/ttyUSB9", "state": {}}', '{"port": "/dev/ttyUSB9"}']
)
def test_a_state_file_with_something_else(tmp_path: Path, text: str) -> None:
    path = tmp_path / "state.json"
    path.write_text(text)
    with pytest.raises(UsageError, match="holds no scan"):
        StateFile(PORT, path).load()


# -- the plan --------------------------------------------------------------------------------


def test_the_usual_rounds() -> None:
    found = rounds(Wanted(), PORT)
    assert [str(item) for item in found] == [
        "slink3 9600 8E1",
        "datalink 9600 8E1",
        "ultra3000 38400 8N1",
    ]
    assert [len(item.addresses) for item in found] == [128, 32, 254]
    assert found[0].seconds(1.5) == pytest.approx(128 * 1.509 + 1.5, abs=0.1)


def test_all_rounds_begin_with_the_usual_ones_and_change_settings_rarely() -> None:
    found = rounds(Wanted(all_settings=True), PORT)
    assert len(found) == 6 * 3 + 10 * 2 + 6 * 5
    assert [str(item) for item in found[:2]] == ["slink3 9600 8E1", "datalink 9600 8E1"]
    settings = [(item.baud, item.format) for item in found]
    changes = sum(one != other for one, other in pairwise(settings))
    assert changes == len(set(settings)) - 1
    usual = [(9600, "8E1"), (38400, "8N1")]
    assert list(dict.fromkeys(settings))[:2] == usual


def test_chosen_rounds() -> None:
    wanted = Wanted(("datalink",), (1200, 300), ("8N1",), (3, 40))
    assert [str(item) for item in rounds(wanted, PORT)] == [
        "datalink 1200 8N1",
        "datalink 300 8N1",
    ]
    assert {item.addresses for item in rounds(wanted, PORT)} == {(3,)}
    only = rounds(Wanted(addresses=(200,)), PORT)
    assert [item.protocol for item in only] == ["ultra3000"]


@pytest.mark.parametrize(
    ("wanted", "port", "why"),
    [
        (Wanted(all_settings=True), "tcp://10.0.0.7:4001", "set in the device server"),
        (Wanted(bauds=(9600, 19200)), "tcp://10.0.0.7:4001", "set in the device server"),
        (Wanted(("slink3",), addresses=(200,)), PORT, "none of these addresses"),
        (Wanted(formats=("9E1",)), PORT, "not of the form"),
        (Wanted(bauds=(7,)), PORT, "out of range"),
    ],
)
def test_what_cannot_be_scanned(wanted: Wanted, port: str, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        rounds(wanted, port)


def test_addresses_and_protocols() -> None:
    assert parse_addresses("0..3") == (0, 1, 2, 3)
    assert parse_addresses("7, 0x10,2..3") == (2, 3, 7, 16)
    for wrong in ("", "a", "5..3", "256", "-1", "1..", "0...3"):
        with pytest.raises(UsageError):
            parse_addresses(wrong)
    assert check_protocols(["datalink", "datalink"]) == ("datalink",)
    with pytest.raises(UsageError, match="no protocol 'modbus'"):
        check_protocols(["modbus"])


# -- the plant file --------------------------------------------------------------------------


def test_a_plant_file_that_is_ready() -> None:
    devices = [
        FoundDevice("slink3", "flexmax", 0, 9600, "8E1", 4.0, "dgfc386"),
        FoundDevice(
            "slink3", "ax-v", 2, 9600, "8E1", 4.0, note='a "note" with\nanything \x00 in it'
        ),
        FoundDevice("slink3", None, 5, 9600, "8E1", error="damaged"),
        FoundDevice("ultra3000", "ultra3000", 0, 38400, "8N1", 2.0, note="2 kW"),
    ]
    text = as_toml('COM"1', devices)
    plant = parse_plant(text, "multidrop.toml", load_profile)
    assert dict(plant.lines) == {"bus": 'COM"1'}
    assert list(plant.devices) == ["flexmax_0", "ax-v_2"]
    assert plant.devices["flexmax_0"].behind == "dgfc386"
    assert plant.devices["ax-v_2"].device.options == {"baud": "9600", "format": "8E1"}
    assert "# At another setting, ultra3000 38400 8N1" in text
    assert "#   profile" not in text
    assert '# profile = "ultra3000"' in text


def test_a_plant_file_of_nothing() -> None:
    assert as_toml(PORT, []) == ""


def test_two_bytes_that_are_a_frame_are_somebody_and_two_others_are_nobody() -> None:
    """An Acknowledge has no more; it tells no protocol, but it is not spoken over."""
    acknowledge = datalink.Frame(datalink.Command.ACKNOWLEDGE, 3).encode()
    for data, speaking in ((acknowledge, True), (b"\x00\xff", False)):
        listening = Listening({"datalink": Ear(PROTOCOLS["datalink"], datalink.decoder())}, 1.0)
        assert listening.start(0.0) == listening.advance(data, 0.5) == b""
        assert not listening.done
        listening.advance(b"", listening.deadline)
        assert (listening.done, listening.speaking, listening.understood) == (True, speaking, None)
