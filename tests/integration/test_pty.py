"""A pseudo-terminal carries the whole of it: simulator, serial library, blocking and asyncio."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

import multidrop
from integration.processes import Simulator, running, simulator
from integration.processes import multidrop as command
from integration.ways import Way
from multidrop import PortError

DEVICES = ("flexmax:0+dgfc386", "ax-v:2")
FULL_OF_MARKS = "FF 00 FF FF 01 FF FF FF 00 00 FF"
"""What a marking port doubles, and what could be taken for its marks."""


@pytest.fixture(scope="module")
def wired(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    """For tests that leave it as it was, but for the value of 8236."""
    link = tmp_path_factory.mktemp("pty") / "drive"
    with simulator(*DEVICES, listen=f"pty:{link}") as started:
        yield started


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Simulator]:
    """For one test alone."""
    with simulator(*DEVICES, listen=f"pty:{tmp_path}/drive") as started:
        yield started


def test_reads_and_writes(own: Simulator, way: Way) -> None:
    before, written, after = way(
        own.device("flexmax:0"),
        ("read", "8236"),
        ("write", "8236", 1234),
        ("read", "8236:int16"),
    )
    assert (before.value, before.type) == (0, "int16")
    assert (written.old.value, written.found.value, written.outcome) == (0, 1234, "confirmed")
    assert (after.value, after.raw) == (1234, b"\xd2\x04")


def test_every_service(wired: Simulator, way: Way) -> None:
    status, card, speed = way(
        wired.device("flexmax:0"),
        ("status",),
        ("read", "dgfc/511"),
        ("read", "actual_speed"),
    )
    assert status.fields["state"] == "switch-on disabled"
    assert card.value == 0
    assert speed.unit == "rpm"
    (ipa,) = way(wired.device("ax-v:2"), ("read", "1009"))
    assert (ipa.value, ipa.fault) == (125, None)


@pytest.mark.parametrize("value", [-1, -256, 255, 0x00FF - 0x8000])
def test_bytes_ff_are_data_where_the_port_marks_errors(
    wired: Simulator, way: Way, value: int
) -> None:
    _, found = way(wired.device("flexmax:0"), ("write", "8236", value), ("read", "8236"))
    assert found.value == value


def test_bytes_ff_in_long_data(wired: Simulator, way: Way) -> None:
    (report,) = way(wired.device("flexmax:0"), ("raw", f"dgfc/CDAB {FULL_OF_MARKS}"))
    assert bytes.fromhex(report.fields["data"]) == bytes.fromhex(FULL_OF_MARKS)


def test_a_trace_shows_bytes_ff_once(wired: Simulator) -> None:
    ran = command("write", wired.device("flexmax:0"), "8236=-1", "--trace")
    assert ran.status == 0
    assert "8236:int16 = -1" in ran.err
    assert " ! " not in ran.err


def test_the_same_port_again_at_once(wired: Simulator, way: Way) -> None:
    for _ in range(3):
        way(wired.device("flexmax:0"), ("read", "8236"))


def test_the_same_port_again_in_one_loop(wired: Simulator) -> None:
    async def twice() -> list[multidrop.Value]:
        found = []
        for _ in range(3):
            async with multidrop.connect_async(wired.device("ax-v:2")) as drive:
                found.append((await drive.read("1009")).value)
        return found

    assert asyncio.run(twice()) == [125, 125, 125]


def test_unplugged_in_the_middle(tmp_path: Path) -> None:
    with (
        simulator(*DEVICES, listen=f"pty:{tmp_path}/drive") as plugged,
        multidrop.connect(plugged.device("flexmax:0")) as drive,
    ):
        assert drive.read("8236").value == 0
        plugged.program.end(signal.SIGKILL)
        for _ in range(2):  # it stays lost
            with pytest.raises(PortError, match=r"drive was lost: .*disconnected"):
                drive.read("8236")


def test_unplugged_in_the_middle_in_asyncio(tmp_path: Path) -> None:
    async def unplug(plugged: Simulator) -> None:
        async with multidrop.connect_async(plugged.device("flexmax:0")) as drive:
            assert (await drive.read("8236")).value == 0
            plugged.program.end(signal.SIGKILL)
            for _ in range(2):
                with pytest.raises(PortError, match="drive was lost: "):
                    await drive.read("8236")

    with simulator(*DEVICES, listen=f"pty:{tmp_path}/drive") as plugged:
        asyncio.run(unplug(plugged))


def test_a_repeated_read_ends_when_it_is_unplugged(own: Simulator) -> None:
    with running("read", own.device("flexmax:0"), "8236", "--every", "0.02") as reading:
        reading.wait_for("8236")
        own.program.end(signal.SIGKILL)
        ran = reading.ended()
    assert ran.status == 5
    assert f"{own.port} was lost" in ran.err


@pytest.mark.parametrize("json", [(), ("--json",)])
def test_watching_ends_when_it_is_unplugged(own: Simulator, json: tuple[str, ...]) -> None:
    with running("watch", own.device("flexmax:0"), "8236", "--every", "0.02", *json) as watching:
        watching.wait_for("8236")
        own.program.end(signal.SIGKILL)
        ran = watching.ended()
    assert ran.status == 5


def test_plugged_in_again(tmp_path: Path) -> None:
    """The link of a simulation that was killed does not keep the next one from starting."""
    for value in (7, 8):
        with simulator(*DEVICES, listen=f"pty:{tmp_path}/drive") as plugged:
            device = plugged.device("flexmax:0")
            assert command("write", device, f"8236={value}").status == 0
            plugged.program.end(signal.SIGKILL)
        assert command("read", device, "8236").status == 5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_link_goes_when_the_simulator_is_told_to_end(
    own: Simulator, number: signal.Signals
) -> None:
    assert os.path.islink(own.port)
    ran = own.program.end(number)
    assert ran.status == (130 if number is signal.SIGINT else 0)
    assert "Traceback" not in ran.err
    assert not os.path.lexists(own.port)


def test_a_link_of_somebody_else_stays(tmp_path: Path) -> None:
    somebody = tmp_path / "drive"
    somebody.write_text("mine")
    ran = command("simulate", "flexmax:0", "--listen", f"pty:{somebody}")
    assert ran.status == 5
    assert f"cannot make {somebody}: File exists" in ran.err
    assert somebody.read_text() == "mine"


def test_a_busy_port(wired: Simulator, way: Way) -> None:
    with multidrop.connect(wired.device("ax-v:2")) as drive:
        with pytest.raises(PortError, match="busy: another program has it open"):
            way(wired.device("ax-v:2"), ("read", "1009"))
        ran = command("read", wired.device("ax-v:2"), "1009")
        assert ran.status == 5
        assert f"cannot open {wired.port}: busy" in ran.err
        assert drive.read("1009").value == 125


def test_a_missing_port(tmp_path: Path, way: Way) -> None:
    missing = f"flexmax:0@{tmp_path}/nothing"
    with pytest.raises(PortError, match="nothing: no such port"):
        way(missing, ("read", "8236"))
    ran = command("read", missing, "8236")
    assert ran.status == 5
    assert "no such port" in ran.err


@pytest.mark.parametrize("what", ["/dev/null", "."])
def test_a_file_that_is_no_port(what: str, way: Way) -> None:
    with pytest.raises(PortError, match="not a serial port"):
        way(f"flexmax:0@{what}", ("read", "8236"))


@pytest.mark.parametrize(
    "pins", [("on", "on"), ("off", "off"), ("leave", "leave"), ("on", "leave")]
)
def test_rts_and_dtr(wired: Simulator, way: Way, pins: tuple[str, str]) -> None:
    """A pseudo-terminal has neither; a port without them is opened all the same."""
    device = wired.device("ax-v:2", rts=pins[0], dtr=pins[1])
    assert way(device, ("read", "1009"))[0].value == 125


def test_a_port_whose_driver_cannot_switch_the_direction(wired: Simulator, way: Way) -> None:
    device = wired.device("ax-v:2", direction="kernel")
    with pytest.raises(PortError, match=r"its driver cannot switch the direction .*direction=auto"):
        way(device, ("read", "1009"))
    assert way(wired.device("ax-v:2"), ("read", "1009"))[0].value == 125  # it was let go


@pytest.mark.parametrize("character", ["7E1", "8O1", "8N2", "8N1"])
@pytest.mark.parametrize("baud", [1200, 19200, 250000])
def test_other_settings(wired: Simulator, way: Way, character: str, baud: int) -> None:
    device = wired.device("ax-v:2", format=character, baud=baud)
    assert way(device, ("read", "1009"))[0].value == 125


def test_paced_in_bursts_with_echo(tmp_path: Path, way: Way) -> None:
    options = ("--pace", "--burst", "16", "--delay", "5", "--echo")
    with simulator(*DEVICES, *options, listen=f"pty:{tmp_path}/drive") as paced:
        written, found = way(paced.device("flexmax:0"), ("write", "8236", -2), ("read", "8236"))
    assert written.outcome == "confirmed"
    assert found.value == -2
    assert found.ms > (11 + 13) * 1.1458 + 5
