"""Every verdict of the doctor, provoked on a wire."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.io.memory import FOREVER, MemoryPort
from multidrop.io.ports import PortSetup
from multidrop.protocols import PROTOCOLS, slink3
from multidrop.protocols.slink3 import FLEXMAX, Master
from multidrop.sim.intruders import OtherMaster, OtherSetting
from multidrop.sim.misread import Setting
from multidrop.timing import Format
from multidrop.tools.doctor.doctor import Case, judge
from multidrop.tools.doctor.evidence import Asked, Evidence, Piece
from multidrop.tools.doctor.report import report
from multidrop.tools.doctor.verdicts import Sure, What, status_of
from unit.tools.doctor.examined import Fault, Ports, examined, line, note, on, verdict
from unit.tools.scan.scanned import Wire

DRIVE, AX = ("flexmax", 0), ("ax-v", 2)
AT = Setting(9600, Format(8, "E", 1))


def requests(*addresses: int) -> list[bytes]:
    return [next(Master(address, FLEXMAX).status_word()).frame.encode() for address in addresses]  # type: ignore[union-attr]


class Silence:
    """A wire with nobody on it; `said` comes once."""

    def __init__(self, said: bytes = b"") -> None:
        self._said = said

    def receive(self, data: bytes, now: float) -> None:
        pass

    @property
    def deadline(self) -> float:
        return 0.0 if self._said else FOREVER

    def send(self, now: float) -> bytes:
        said, self._said = self._said, b""
        return said


# -- nobody, or only ourselves -------------------------------------------------------------------


def test_a_healthy_line() -> None:
    case = examined(on(line(DRIVE, AX)), 0, 2)
    found = judge(case)
    assert [item.what for item in found] == [What.HEALTHY]
    assert "20 of 20 reads of 2 devices (0, 2) answered after 3.0 ms" in found[0].text
    assert status_of(found) == 0


def test_devices_are_found_among_many_addresses() -> None:
    case = examined(on(line(DRIVE, AX)), *range(8), times=3)
    assert "6 of 6 reads of 2 devices (0, 2)" in verdict(case, What.HEALTHY).text


def test_a_device_that_answers_late_is_found_among_many_addresses() -> None:
    wire = line(DRIVE, AX, faults=[None, Fault.LATE_ANSWER], late=0.5)
    case = examined(on(wire), *range(8), times=3)
    assert "2 devices (0, 2)" in verdict(case, What.HEALTHY).text


def test_not_one_byte() -> None:
    found = verdict(examined(Ports(lambda setting: Silence()), 0, 1), What.NO_BYTES)
    assert found.text == "not one byte came back: 4 reads of 2 addresses at slink3 9600 8E1"
    assert found.status == 4


def test_a_glitch_is_no_answer() -> None:
    found = verdict(examined(Ports(lambda setting: Silence(b"\0")), 0), What.NO_BYTES)
    assert "not one byte" in found.text  # it came before anything was asked


def test_echo_only() -> None:
    found = verdict(examined(on(line(DRIVE, echo=True)), 5), What.ECHO_ONLY)
    assert "the line hears itself, and nobody answers (1 address" in found.text
    assert found.proof[1].startswith("< 01 05 00 08 00 23 00 2E")
    assert found.status == 4


def test_a_line_with_echo_and_answers_is_healthy() -> None:
    found = verdict(examined(on(line(DRIVE, echo=True)), 0), What.HEALTHY)
    assert "The line hears itself, which is fine." in found.text


# -- another setting -----------------------------------------------------------------------------


@pytest.mark.parametrize("baud", [1200, 2400, 4800, 19200, 38400])
def test_a_master_at_another_baud_rate_is_found_there(baud: int) -> None:
    """What is heard at the setting that was asked for is garbage; another one is listened to."""
    sent = Setting(baud, Format(8, "E", 1))

    def at(setting: Setting) -> OtherSetting:
        busy = OtherMaster(line(DRIVE, AX).attach(), requests(0, 2), 0.1)
        return OtherSetting(busy, sent, setting)

    ports = Ports(at)
    case = examined(ports, 0, 1, 2)
    found = verdict(case, What.SETTINGS)
    assert found.sure is Sure.CERTAIN
    assert found.text == f"the line is at {baud} 8E1 (slink3), and was listened to at 9600 8E1"
    assert ports.sent == b""
    assert found.status == 6


@pytest.mark.parametrize("baud", [1200, 4800, 9600])
def test_swapped_wires_look_like_it(baud: int) -> None:
    sent = Setting(baud, Format(8, "E", 1))

    def at(setting: Setting) -> OtherSetting:
        busy = OtherMaster(line(DRIVE, AX).attach(), requests(0, 2, 1, 3), 0.1)
        return OtherSetting(busy, sent, setting, inverted=True)

    found = verdict(examined(Ports(at), 0, url="tcp://10.0.0.7:4001"), What.SETTINGS)
    assert found.sure is Sure.LIKELY
    assert "A and B swapped" in found.text
    assert "swap A and B, which harms nothing" in found.advice


@pytest.mark.parametrize("parity", "NO")
def test_a_master_of_another_parity_and_baud_rate(parity: str) -> None:
    """A port that expects even parity marks what has none; so the other formats are tried there."""
    sent = Setting(19200, Format(8, parity, 1))

    def at(setting: Setting) -> OtherSetting:
        busy = OtherMaster(line(DRIVE, AX).attach(), requests(0, 2), 0.1)
        return OtherSetting(busy, sent, setting, marks=setting.format.parity != "N")

    class Marked(Ports):
        def __call__(self, url: str, setup: PortSetup) -> MemoryPort:
            self._marks = setup.settings.format.parity != "N"
            return super().__call__(url, setup)

    found = verdict(examined(Marked(at), 0), What.SETTINGS)
    assert found.text.startswith(f"the line is at {sent} (slink3)")


def test_noise_is_no_setting() -> None:
    noise = bytes(number * 37 % 256 for number in range(200))
    found = verdict(examined(Ports(lambda setting: Silence(noise)), 0), What.SETTINGS)
    assert found.sure is Sure.POSSIBLE
    assert "multidrop scan /dev/ttyS9 --all-settings" in found.advice[0]


def test_another_parity_shows_in_the_marks_of_a_port() -> None:
    sent = Setting(9600, Format(8, "N", 1))

    def at(setting: Setting) -> OtherSetting:
        return OtherSetting(line(DRIVE).attach(), sent, setting, marks=True)

    found = verdict(examined(Ports(at, marks=True), 0), What.SETTINGS)
    assert found.sure is Sure.CERTAIN
    assert "another format than 8E1" in found.text


# -- damage --------------------------------------------------------------------------------------


class Flipping:
    """A wire on which every `each`th byte has a parity error."""

    def __init__(self, inner: object, each: int) -> None:
        self._inner, self._each, self._count = inner, each, 0

    def receive(self, data: bytes, now: float) -> None:
        self._inner.receive(data, now)  # type: ignore[attr-defined]

    @property
    def deadline(self) -> float:
        return self._inner.deadline  # type: ignore[attr-defined, no-any-return]

    def send(self, now: float) -> bytes:
        out = bytearray()
        for byte in self._inner.send(now):  # type: ignore[attr-defined]
            self._count += 1
            wrong = self._count % self._each == 0
            out += bytes((0xFF, 0, byte ^ 1)) if wrong else bytes((byte,))
        return bytes(out)


def test_parity_errors() -> None:
    ports = Ports(lambda setting: Flipping(line(DRIVE).attach(), 27), marks=True)
    found = verdict(examined(ports, 0), What.PARITY)
    assert found.text.startswith("3 of 100 bytes came with a parity or framing error (3.0%)")


def test_damaged_answers_with_their_rate_for_each_device() -> None:
    faults = [*[None] * 10, *[Fault.WRONG_CHECKSUM, None] * 5]
    found = verdict(examined(on(line(DRIVE, AX, faults=faults)), 0, 2), What.CHECKSUMS)
    assert found.text == "some answers are damaged: 5 of 20 (25%)"
    assert found.proof[0] == "address 0: 0 of 10 answers damaged (0%)"
    assert found.proof[1] == "address 2: 5 of 10 answers damaged (50%)"
    assert "checksum" in found.proof[3]
    assert "only those of address 2" in found.advice[0]


def test_answers_that_are_always_damaged_alike() -> None:
    wire = line(("53mc5000", 3), faults=[Fault.WRONG_CHECKSUM] * 99, protocol="datalink")
    found = verdict(examined(on(wire), 3, protocol="datalink"), What.SETTINGS)
    assert "something answers at address 3, each of" in found.text
    assert "in the same way" in found.text


def test_answers_that_are_damaged_in_other_ways_each_time() -> None:
    """The sequence number makes each one different; two devices at once do too."""
    wire = line(DRIVE, faults=[Fault.WRONG_CHECKSUM] * 99)
    found = verdict(examined(on(wire), 0), What.SAME_ADDRESS)
    assert found.sure is Sure.POSSIBLE


def test_two_devices_with_one_address() -> None:
    found = verdict(examined(on(line(DRIVE, DRIVE)), 0), What.SAME_ADDRESS)
    assert found.sure is Sure.CERTAIN
    assert "address 0 answers twice, 10 times of 10" in found.text


def test_a_second_device_that_takes_longer() -> None:
    answer = bytes.fromhex("01 00 00 0A 01 00 00 40 02 49")

    def answers(frame: slink3.Frame) -> list[tuple[float, bytes]]:
        both = slink3.Frame.decode(answer).numbered(frame.control >> 2).encode()
        return [(0.015, both), (0.055, both)]

    wire = Wire("slink3", answers)
    found = verdict(examined(Ports(lambda setting: wire), 0), What.SAME_ADDRESS)
    assert "10 times of 10" in found.text


def test_damaged_answers_cost_no_whole_time_out() -> None:
    case = examined(on(line(DRIVE, faults=[Fault.CUT_SHORT] * 99)), 0)
    starts = [asked.start for asked in case.visits[0].asked]
    assert len(starts) == 8  # so many without an answer are enough
    assert all(later - sooner < 1.0 for sooner, later in pairwise(starts))


def test_a_line_that_never_falls_silent_is_no_trap() -> None:
    ports = Ports(
        lambda setting: OtherMaster(line().attach(), [b"\x55" * 8], 0.2, first=0.6, unanswered=True)
    )
    case = examined(ports, 0)
    assert len(case.visits[0].asked) == 8
    assert status_of(judge(case)) == 6


def test_the_fault_twice_is_such_a_line() -> None:
    verdict(examined(on(line(DRIVE, faults=[Fault.TWICE] * 2)), 0), What.SAME_ADDRESS)


def test_lost_answers() -> None:
    found = verdict(examined(on(line(DRIVE, faults=[None, Fault.NO_ANSWER])), 0), What.SILENT)
    assert "address 0 left 1 of 10 reads unanswered" in found.text
    assert found.status == 4


# -- time ----------------------------------------------------------------------------------------


def test_late_answers() -> None:
    found = verdict(examined(on(line(DRIVE, faults=[Fault.LATE_ANSWER], late=2.0)), 0), What.LATE)
    assert "after up to 2003 ms, 1 of 10 times over the 1520 ms" in found.text
    assert found.advice == ("wait longer: timeout=3.0",)


def test_answers_that_are_late_for_the_time_that_was_set() -> None:
    wire = line(("53mc5000", 3), faults=[Fault.LATE_ANSWER] * 9, late=0.2, protocol="datalink")
    found = verdict(examined(on(wire), 3, protocol="datalink", timeout=0.1), What.LATE)
    assert "9 of 10 times over the 100 ms" in found.text


def test_gaps_within_an_answer() -> None:
    found = verdict(examined(on(line(DRIVE, faults=[Fault.GAP, None, Fault.GAP])), 0), What.GAPS)
    assert (
        "address 0 pauses within 2 of its answers, up to 500 ms; a frame ends after 37 ms"
        in found.text
    )


def test_an_adapter_that_collects_bytes() -> None:
    wire = line(("flexmax", 0), burst=0.016)
    case = examined(on(wire), 0)
    verdict(case, What.HEALTHY)
    found = note(case, What.LATENCY)
    assert "11 ms of an answer come at once" in found.text
    assert found.advice[0] == (
        "Linux: echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyS9/latency_timer"
    )
    assert found.status == 0


# -- other masters -------------------------------------------------------------------------------


def test_a_master_that_is_there_is_not_spoken_over() -> None:
    ports = Ports(lambda setting: OtherMaster(line(DRIVE, AX).attach(), requests(0, 2), 0.1))
    found = verdict(examined(ports, 0, 2, seconds=1.0), What.SECOND_MASTER)
    assert (
        "a master speaks slink3 9600 8E1: 11 requests in 1 s; answers come from 0, 2; so nothing"
        in found.text
    )
    assert ports.sent == b""
    assert found.status == 6


def test_a_master_that_is_only_listened_to() -> None:
    ports = Ports(lambda setting: OtherMaster(line(DRIVE, AX).attach(), requests(0, 2), 0.1))
    case = examined(ports, seconds=1.0, listen_only=True)
    assert verdict(case, What.HEALTHY).sure is Sure.LIKELY
    assert note(case, What.SOMEBODY).status == 0


def test_a_master_that_begins_later_ends_the_asking() -> None:
    ports = Ports(
        lambda setting: OtherMaster(
            line(DRIVE).attach(), requests(2), 5.0, first=0.9, unanswered=True
        )
    )
    case = examined(ports, 0, times=100)
    found = verdict(case, What.SECOND_MASTER)
    assert "between our reads" in found.text
    assert len(case.visits[0].asked) < 50


def test_two_masters_at_once() -> None:
    said = [one + other for one, other in zip(requests(0, 1), requests(2, 3), strict=True)]
    ports = Ports(lambda setting: OtherMaster(line().attach(), said, 0.2, unanswered=True))
    case = examined(ports, seconds=2.0, listen_only=True)
    found = verdict(case, What.COLLISIONS)
    assert "questions came before the one before could be answered" in found.text


def test_a_request_that_comes_back_changed() -> None:
    class Spoiled(Silence):
        """An echo, whole or not, and no answers."""

        def __init__(self) -> None:
            super().__init__()
            self._count = 0

        def receive(self, data: bytes, now: float) -> None:
            self._count += 1
            self._said = data if self._count % 2 else bytes(byte & 0x5A for byte in data)

    found = [item.what for item in judge(examined(Ports(lambda setting: Spoiled()), 0))]
    assert What.COLLISIONS in found


# -- only listening ------------------------------------------------------------------------------


def test_nothing_to_hear() -> None:
    ports = Ports(lambda setting: Silence())
    found = verdict(examined(ports, listen_only=True), What.NO_BYTES)
    assert found.status == 4
    assert ports.sent == b""


def heard_with(*faults: Fault | None, late: float = 3.0) -> Ports:
    def at(setting: Setting) -> OtherMaster:
        return OtherMaster(line(DRIVE, faults=faults, late=late).attach(), requests(0), 5.0)

    return Ports(at)


@pytest.mark.parametrize(
    ("fault", "what"),
    [
        (Fault.WRONG_CHECKSUM, What.CHECKSUMS),
        (Fault.GAP, What.GAPS),
        (Fault.NO_ANSWER, What.SILENT),
    ],
)
def test_the_traffic_of_others(fault: Fault, what: What) -> None:
    verdict(examined(heard_with(fault, None, None), seconds=16.0, listen_only=True), what)


def test_an_acknowledge_that_comes_late() -> None:
    datalink = PROTOCOLS["datalink"]
    change = bytes.fromhex("7E A3 03 3E 07 4B 40 08 7E 00")
    wire = line(("53mc5000", 3), protocol="datalink")
    busy = OtherMaster(wire.attach(), [change, bytes.fromhex("7E 83")], 0.095)
    case = examined(
        Ports(lambda setting: busy), protocol="datalink", seconds=0.15, listen_only=True
    )
    found = verdict(case, What.ACKNOWLEDGE)
    assert "1 of 1 changes were acknowledged late, up to" in found.text
    assert len(found.proof) == 3
    assert datalink.name == "datalink"


def test_late_answers_of_others() -> None:
    """Behind the longest time of its protocol an answer is none any more."""
    ports = heard_with(Fault.LATE_ANSWER, None, None, late=1.6)
    verdict(examined(ports, seconds=16.0, listen_only=True), What.SILENT)
    ports = heard_with(Fault.LATE_ANSWER, None, None, late=0.3)
    case = examined(ports, seconds=16.0, listen_only=True, timeout=0.2)
    late = verdict(case, What.LATE)
    assert late.text == "address 0 answered 1 times after more than 200 ms"
    assert "answered after 312 ms" in late.proof[0]


def test_parity_errors_of_others() -> None:
    def at(setting: Setting) -> Flipping:
        busy = OtherMaster(line(DRIVE).attach(), requests(0), 0.1)
        return Flipping(busy, 40)

    case = examined(Ports(at, marks=True), seconds=2.0, listen_only=True)
    assert "with a parity or framing error" in verdict(case, What.PARITY).text


def test_others_in_another_format() -> None:
    sent = Setting(9600, Format(8, "N", 1))

    def at(setting: Setting) -> OtherSetting:
        busy = OtherMaster(line(DRIVE).attach(), requests(0), 0.1)
        return OtherSetting(busy, sent, setting, marks=True)

    case = examined(Ports(at, marks=True), seconds=1.0, listen_only=True)
    found = [item for item in judge(case) if item.what is What.SETTINGS]
    assert "the line has another format than 8E1" in found[0].text


# -- whatever comes ------------------------------------------------------------------------------

BYTES = st.one_of(
    st.binary(max_size=12),
    st.sampled_from([*requests(0, 2), bytes.fromhex("01 00 00 0A 01 00 00 40 02 49")]),
    st.sampled_from([bytes.fromhex("7E E3 01 02 80 66"), bytes.fromhex("7E 23 01 02 80 06 AC")]),
    st.just(b":000000DD\r\n"),
)


@st.composite
def heard_pieces(draw: st.DrawFn) -> tuple[Piece, ...]:
    now = 0.0
    pieces = []
    for data in draw(st.lists(BYTES, max_size=8)):
        now += draw(st.floats(0.0, 2.0))
        pieces.append(Piece(data, now, draw(st.booleans())))
    return tuple(piece for piece in pieces if piece.data)


@given(st.data(), st.sampled_from(sorted(PROTOCOLS)), st.booleans(), st.booleans())
def test_there_is_always_a_verdict(
    data: st.DataObject, name: str, network: bool, listen_only: bool
) -> None:
    module = PROTOCOLS[name]
    asked = []
    for number in range(data.draw(st.integers(0, 4))):
        frame = module.prober.probe(number % 2).numbered(number)
        pieces = data.draw(heard_pieces())
        asked.append(Asked(frame, frame.encode(), 0.0, 0.01, pieces, data.draw(st.booleans())))
    heard = data.draw(heard_pieces())
    visit = Evidence("/dev/x", module, module.line, network, 1.0, heard, tuple(asked), 16)
    case = Case((visit,), listen_only)
    found = judge(case)
    assert found
    assert all(item.text for item in found)
    text = report(case, found, "0", "now")
    assert all(piece.data.hex(" ").upper() in text for piece in heard)


def test_who_only_listens_leaves_the_ports_pins_alone() -> None:
    setups = []

    class Noted(Ports):
        def __call__(self, url, setup):  # type: ignore[no-untyped-def]
            setups.append(setup.options)
            return super().__call__(url, setup)

    examined(Noted(lambda setting: Silence()), listen_only=True)
    examined(Noted(lambda setting: Silence()), 0)
    assert [(item.rts, item.dtr) for item in setups] == [("leave", "leave"), ("on", "on")]
