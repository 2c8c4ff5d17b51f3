"""`multidrop scan` against simulated lines over TCP and pseudo-terminals, and against other masters."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from integration.processes import COMMAND, PATIENCE, Address, Ran, Running, multidrop, simulator
from integration.servers import Connected, Server, serving
from integration.terminal import on_terminal
from integration.threads import served
from multidrop.catalog import load_profile
from multidrop.naming import parse_simulated
from multidrop.plantfile import load_plant
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.slink3 import Frame
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import NoFaults
from multidrop.sim.line import LineFaults, Pace, SimulatedLine

LINES = {
    "slink3": (("flexmax:0+dgfc386", "ax-v:2", "dgfc386:7"), ["flexmax:0", "ax-v:2", "dgfc386:7"]),
    "datalink": (("53mc5000:3", "53sl6000:4"), ["53mc5000:3", "53sl6000:4"]),
    "ultra3000": (("ultra3000:0", "ultra3000:5"), ["ultra3000:0", "ultra3000:5"]),
}
QUICK = ("--listen", "0.1", "--addresses", "0..7")


@pytest.fixture(autouse=True)
def state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


def line_of(
    *devices: str, echo: bool = False, delay: float = 0.0
) -> AbstractContextManager[Address]:
    """These devices behind a TCP port."""
    made = [simulated_device(*parse_simulated(text)) for text in devices]
    settings = PROTOCOLS[load_profile(devices[0].partition(":")[0]).protocol].line
    return served(
        SimulatedLine(
            made,
            settings.decoder,
            character=settings.character,
            pace=Pace(answer_delay=delay),
            faults=LineFaults(NoFaults(), echo=echo),
        )
    )


def names(ran: Ran) -> list[str]:
    return [f"{item['profile']}:{item['address']}" for item in ran.objects]


@pytest.mark.parametrize("protocol", LINES)
def test_over_tcp(protocol: str, state_folder: Path) -> None:
    devices, expected = LINES[protocol]
    with line_of(*devices) as line:
        ran = multidrop("scan", line.port, "--protocol", protocol, "--json", *QUICK)
    assert ran.status == 0
    assert names(ran) == expected
    settings = PROTOCOLS[protocol].line
    for item in ran.objects:
        assert (item["v"], item["protocol"]) == (1, protocol)
        assert (item["baud"], item["format"]) == (settings.baud, str(settings.format))
    assert f"{protocol} {settings.baud} {settings.format} (8 addresses)" in ran.err
    assert "--thorough" in ran.err
    assert not list((state_folder / "multidrop" / "scan").iterdir())


@pytest.mark.parametrize("protocol", LINES)
def test_over_a_pseudo_terminal(protocol: str, tmp_path: Path) -> None:
    """The result is a plant file whose names are known."""
    devices, expected = LINES[protocol]
    others = () if protocol == "ultra3000" else ("--protocol", protocol)  # opened at two settings
    with simulator(*devices, listen=f"pty:{tmp_path}/line") as line:
        ran = multidrop("scan", line.port, "-o", "multidrop.toml", *others, *QUICK, cwd=tmp_path)
    assert ran.status == 0
    assert "written to multidrop.toml" in ran.err
    plant = load_plant(tmp_path / "multidrop.toml", load_profile)
    assert list(plant.devices) == [name.replace(":", "_") for name in expected]
    assert list(plant.lines.values()) == [line.port]
    assert all(name in ran.out for name in expected)


def test_the_plant_file_is_printed(tmp_path: Path) -> None:
    """And the traffic is shown, and recorded."""
    pcap = str(tmp_path / "scan.pcapng")
    with line_of("ax-v:2") as line:
        ran = multidrop("scan", line.port, *ONLY, "--trace", "--addresses", "2", "--capture", pcap)
    packets = multidrop("decode", pcap)
    assert "status word" in packets.out
    assert "read 511: refused" in packets.out
    table, _, plant = ran.out.partition("[line.bus]\n")
    assert "ax-v:2" in table
    assert f'port = "{line.port}"' in plant
    assert "[line.bus.device.ax-v_2]\n" in plant
    assert "> 01 02 00 08 00 23 00 29  | 2 #0 status word" in ran.err
    assert "2 #0 unknown command" in ran.err


def test_a_line_that_hears_itself() -> None:
    with line_of("ultra3000:5", echo=True) as line:
        ran = multidrop("scan", line.port, "--protocol", "ultra3000", "--json", *QUICK)
    assert names(ran) == ["ultra3000:5"]
    assert "hears itself" in ran.err


def test_slow_devices_are_found() -> None:
    """Their answers come while others are asked."""
    with line_of("ax-v:2", "ax-v:3", delay=0.25) as line:
        ran = multidrop("scan", line.port, "--protocol", "slink3", "--json", *QUICK)
    assert names(ran) == ["ax-v:2", "ax-v:3"]
    assert all(item["ms"] >= 225 for item in ran.objects)


# -- servers that behave as other masters, or as nobody ---------------------------------------

POLL = Frame(11, 0x0C, 0, 0x26, b"\x03\xf1\x03").encode()
ONLY = ("--protocol", "slink3", "--timeout", "0.02")


def silent(line: Connected) -> None:
    for _ in line.requests():
        pass


def polling(line: Connected) -> None:
    while True:
        line.send(POLL)
        line.pause(0.02)


def polling_later(line: Connected) -> None:
    for number, _ in enumerate(line.requests()):
        if number == 5:
            line.send(POLL)


def test_another_master_is_not_spoken_over() -> None:
    with serving(polling) as server:
        ran = multidrop("scan", server.port, *ONLY, "--listen", "0.2")
    assert ran.status == 2
    assert ran.out == ""
    assert "another master speaks slink3" in ran.err
    assert "| 11 #3 read typed parameter 1009:int16" in ran.err
    assert "--anyway" in ran.err
    assert not server.received


def test_anyway() -> None:
    def behave(line: Connected) -> None:
        line.send(POLL)
        silent(line)

    with serving(behave) as server:
        ran = multidrop("scan", server.port, *ONLY, "--anyway", "--addresses", "3")
    assert ran.status == 4
    assert server.frames() == [Frame(3, code=0x23)]


def test_a_master_that_comes_later_ends_it() -> None:
    with serving(polling_later) as server:
        ran = multidrop("scan", server.port, *ONLY, "--listen", "0.05")
        assert ran.status == 6
        assert "another master speaks slink3" in ran.err
        assert f"multidrop scan {server.port} --resume" in ran.err
        sent = len(server.frames())
        assert 6 <= sent < 20


def test_nobody_answers() -> None:
    with serving(silent) as server:
        ran = multidrop("scan", server.port, *ONLY, *QUICK)
    assert ran.status == 4
    assert ran.out == ""
    assert "nobody answered" in ran.err


def test_two_devices_with_one_address() -> None:
    def both(line: Connected) -> None:
        for request in line.requests():
            if request.address == 5:
                line.send(bytes.fromhex("01 05 00 08 01 18 7F 00"))

    with serving(both) as server:
        ran = multidrop("scan", server.port, *ONLY, "--json", *QUICK)
    assert ran.status == 4
    assert ran.object["profile"] is None
    assert ran.object["address"] == 5
    assert ran.object["error"]["kind"] == "protocol"
    assert "two devices with this address" in ran.object["error"]["text"]


def test_a_port_that_is_lost() -> None:
    def leave(line: Connected) -> None:
        for number, _ in enumerate(line.requests()):
            if number == 5:
                return

    with serving(leave) as server:
        ran = multidrop("scan", server.port, *ONLY, "--listen", "0")
        assert ran.status == 5
        assert ran.err.count("was lost") == 1
        assert "--resume  goes on at slink3 9600 8E1, address" in ran.err


# -- Ctrl-C and going on -----------------------------------------------------------------------


@contextmanager
def half_way(server: Server, *arguments: str) -> Iterator[Running]:
    """A scan that has asked some addresses."""
    program = Running(COMMAND, "scan", server.port, *ONLY, "--listen", "0", *arguments)
    try:
        until = time.monotonic() + PATIENCE
        while len(server.frames()) < 80 and time.monotonic() < until:
            time.sleep(0.005)
        yield program
    finally:
        program.end()


def test_ctrl_c_and_going_on(tmp_path: Path) -> None:
    def one(line: Connected) -> None:
        for request in line.requests():
            if request.address in (3, 127):
                line.send(Frame(request.address, request.control, 1, 0x18).encode())

    state = str(tmp_path / "scan.json")
    with serving(one) as server:
        with half_way(server, "--state", state) as program:
            ran = program.interrupt()
        assert ran.status == 130
        assert "Traceback" not in ran.err
        assert "interrupted" in ran.err
        assert "answered at slink3 9600 8E1: 3" in ran.err
        assert f"multidrop scan {server.port} --resume --state {state}" in ran.err
        kept = json.loads(Path(state).read_text())
        assert kept["state"]["left"][-1] == 127

        before = len(server.frames())
        again = multidrop("scan", server.port, "--resume", "--state", state, "--json")
        assert [item["address"] for item in again.objects] == [3, 127]
        asked = [frame.address for frame in server.frames()[before:] if frame.code == 0x23]
        assert min(address for address in asked if address != 3) > 0
        assert 0 not in asked
        assert not Path(state).exists()
        assert multidrop("scan", server.port, "--resume", "--state", state).status == 2


def test_a_scan_that_begins_anew_says_so(tmp_path: Path) -> None:
    state = tmp_path / "scan.json"
    state.write_text("{}")
    with serving(silent) as server:
        ran = multidrop("scan", server.port, *ONLY, *QUICK, "--state", str(state))
    assert "was not finished; this one begins anew" in ran.err
    assert not state.exists()


def test_a_bar_on_a_terminal() -> None:
    with (
        serving(silent) as server,
        on_terminal("scan", server.port, *ONLY, "--listen", "0", "--timeout", "0.1") as terminal,
    ):
        terminal.wait_for("slink3 9600 8E1")
        terminal.wait_for("━")
        assert terminal.interrupt() == 130
        assert "--resume" in terminal.shown
        assert "Traceback" not in terminal.shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--thorough", "--timeout", "1"), "give one of them"),
        (("--timeout", "0"), "out of range"),
        (("--listen", "-1"), "out of range"),
        (("--protocol", "modbus"), "there is no protocol 'modbus'"),
        (("--addresses", "5..3"), "not of the form 0..31"),
        (("--all-settings",), "set in the device server"),
        (("--resume",), "there is no scan of"),
        (("--format", "9N1"), "not of the form 8E1"),
        (("--rts", "maybe"), "none of on, off, leave"),
    ],
)
def test_usage(arguments: tuple[str, ...], message: str) -> None:
    ran = multidrop("scan", "tcp://127.0.0.1:1", *arguments)
    assert (ran.status, ran.out) == (2, "")
    assert message in ran.err


def test_a_file_is_not_replaced_unasked(tmp_path: Path) -> None:
    (tmp_path / "multidrop.toml").write_text("mine")
    ran = multidrop("scan", "tcp://127.0.0.1:1", "-o", "multidrop.toml", cwd=tmp_path)
    assert ran.status == 2
    assert "multidrop.toml is there already; --force replaces it" in ran.err
    assert (tmp_path / "multidrop.toml").read_text() == "mine"


@pytest.mark.parametrize(
    ("output", "message"),
    [(("nowhere/plant.toml",), "there is no folder nowhere"), ((".", "--force"), "is a folder")],
)
def test_a_place_that_cannot_be_written_is_found_before_the_scan(
    tmp_path: Path, output: tuple[str, ...], message: str
) -> None:
    ran = multidrop("scan", "tcp://127.0.0.1:1", "-o", *output, cwd=tmp_path)
    assert ran.status == 2
    assert message in ran.err


def test_nobody_is_no_plant(tmp_path: Path) -> None:
    """With --force too: the plant file that is there was once right."""
    (tmp_path / "multidrop.toml").write_text("mine")
    with serving(silent) as server:
        asked = ("scan", server.port, *ONLY, *QUICK, "-o", "multidrop.toml", "--force")
        ran = multidrop(*asked, cwd=tmp_path)
    assert ran.status == 4
    assert "multidrop.toml is not written: there is nothing to write into it" in ran.err
    assert (tmp_path / "multidrop.toml").read_text() == "mine"


def test_a_state_that_cannot_be_removed_keeps_nothing_from_being_shown(tmp_path: Path) -> None:
    """It is another user's file, say, or as here a folder."""
    with serving(silent) as server:
        ran = multidrop("scan", server.port, *ONLY, *QUICK, "--state", str(tmp_path))
    assert ran.status == 4
    assert "--resume will not work" in ran.err
    assert "nobody answered" in ran.err


def test_a_port_has_keys_of_its_own() -> None:
    ran = multidrop("scan", "tcp://127.0.0.1:1,baud=9600")
    assert ran.status == 2
    assert "a port to scan has the keys rts dtr direction, not 'baud'" in ran.err
    assert multidrop("scan", "tcp://127.0.0.1:1,rts=off").status == 5
