"""`sniff`, `decode` and `--capture`: real ports, real masters, and a listener that never speaks."""

from __future__ import annotations

import contextlib
import csv
import io
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from unit.tools.captures.captures import Talk, answer, busy, question

from integration.processes import PATIENCE, Running, multidrop, running
from integration.servers import Connected, Server
from multidrop import connect
from multidrop.errors import DeviceError, NoReply
from multidrop.io.capture import CaptureReader
from multidrop.io.connection import Connection


@contextlib.contextmanager
def tapped(*devices: str, tap: str = "tcp://127.0.0.1:0") -> Iterator[tuple[str, str]]:
    """A simulated line: where its master speaks, and where others may listen."""
    arguments = ("simulate", *devices, "--listen", "tcp://127.0.0.1:0", "--tap", tap)
    with running(*arguments) as simulating:
        port = simulating.wait_for("listening on ").removeprefix("listening on ")
        yield port, simulating.wait_for("listen to it at ").removeprefix("listen to it at ")


@contextlib.contextmanager
def sniffing(ear: str, *arguments: str, cwd: Path | None = None) -> Iterator[Running]:
    with running("sniff", ear, *arguments, cwd=cwd) as sniffer:
        yield sniffer


def ask_until_heard(sniffer: Running, drive: Connection, point: str) -> None:
    """Read until the listener prints something: only then does it really listen."""
    until = time.monotonic() + PATIENCE
    while not sniffer.out and time.monotonic() < until:
        drive.read(point)
        time.sleep(0.05)
    assert sniffer.out, sniffer.err


@pytest.mark.parametrize(
    ("device", "point", "protocol"),
    [
        ("ax-v:2", "1009", "slink3"),
        ("53mc5000:3", "C103", "datalink"),
        ("ultra3000:0", "0x06D", "ultra3000"),
    ],
)
def test_the_protocol_is_told_and_what_came_before_is_decoded(
    device: str, point: str, protocol: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.pcapng"
    profile, address = device.split(":")
    with (
        tapped(device) as (port, ear),
        connect(f"{device}@{port}") as drive,
        sniffing(ear, "--json", "-o", str(path)) as sniffer,
    ):
        ask_until_heard(sniffer, drive, point)
        ran = sniffer.interrupt()
    assert ran.status == 130
    assert f"the line speaks {protocol}" in ran.err
    heard = [line for line in ran.objects if line["kind"] == "read" and "error" not in line]
    assert len(heard) >= 2  # before three frames were heard, the protocol was not known
    assert {line["device"] for line in heard} == {f"{protocol}:{address}@{ear}"}
    decoded = multidrop("decode", str(path), "--json", "--device-profile", f"{address}={profile}")
    assert decoded.status == 0
    assert [line["raw"] for line in decoded.objects] == [line["raw"] for line in ran.objects]
    assert {line["device"] for line in decoded.objects} == {f"{device}@{ear}"}


def test_on_a_pseudo_terminal(tmp_path: Path) -> None:
    with (
        tapped("ax-v:2", tap=f"pty:{tmp_path}/ear") as (port, ear),
        connect(f"ax-v:2@{port}") as drive,
        sniffing(ear, "--device-profile", "2=ax-v") as sniffer,
    ):
        ask_until_heard(sniffer, drive, "1009")
        line = sniffer.wait_for("read ipa_1009 (1009) = 125")
        ran = sniffer.interrupt()
    assert "ax-v:2" in line
    assert "interrupted" in ran.err
    assert "ax-v:2" in ran.err


def test_writes_refusals_and_silence_with_names_of_the_plant(tmp_path: Path) -> None:
    with tapped("ax-v:2") as (port, ear), connect(f"ax-v:2@{port}") as drive:
        (tmp_path / "multidrop.toml").write_text(
            f'[line.press]\nport = "{ear}"\n[line.press.device.winder]\nprofile = "ax-v"\naddress = 2\n'
        )
        with sniffing("press", "--json", cwd=tmp_path) as sniffer:
            ask_until_heard(sniffer, drive, "1009")
            drive.write("1111", 7)
            with pytest.raises(DeviceError):
                drive.read("77")
            nobody = connect(f"slink3:9@{port},timeout=0.1,attempts=1")
            with nobody, pytest.raises(NoReply):
                nobody.read("1:int16")
            sniffer.wait_for('"no-reply"')
            ran = sniffer.interrupt()
    kinds = [(line["kind"], line.get("error", {}).get("kind")) for line in ran.objects]
    assert ("read", "refused") in kinds
    assert ("read", "no-reply") in kinds
    (write,) = [line for line in ran.objects if line["kind"] == "write"]
    assert (write["point"], write["value"], write["device"]) == ("1111", 7, f"ax-v:2@{ear}")
    assert "winder" in ran.err


def test_not_a_byte_is_sent_and_garbage_is_told() -> None:
    done = threading.Event()

    def babble(connected: Connected) -> None:
        for _ in range(40):
            connected.send(b"\x55\x7e\x12" * 8)
        done.wait(20)

    server = Server(babble)
    try:
        with sniffing(server.port, "--seconds", "1.5") as sniffer:
            sniffer.wait_for("is the line really at 9600 8E1?")
            ran = sniffer.ended()
    finally:
        done.set()
        server.close()
    assert server.received == b""
    assert ran.status == 0
    assert "960 bytes, and no frame of any protocol in them" in ran.err


def test_a_port_that_is_lost_ends_with_a_summary() -> None:
    server = Server(lambda connected: connected.send(question(1, 1).encode()))
    try:
        ran = multidrop("sniff", server.port, "--protocol", "slink3")
    finally:
        server.close()
    assert ran.status == 5
    assert "1 without an answer" in ran.err
    assert "was lost" in ran.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("/dev/nowhere",), "no such port"),
        (("tcp://127.0.0.1:1", "--protocol", "modbus"), "there is no protocol 'modbus'"),
        (("tcp://127.0.0.1:1", "--device-profile", "ax-v"), "is not ADDRESS=PROFILE"),
        (("tcp://127.0.0.1:1", "--json", "--csv"), "one of them"),
        (("tcp://127.0.0.1:1,baud",), "'baud' is not key=value"),
        (("tcp://127.0.0.1:1", "--baud", "7"), "baud rate 7 is out of range"),
        (("tcp://127.0.0.1:1", "--kind", "refusd"), "did you mean 'refused'"),
    ],
)
def test_what_cannot_be_listened_to(arguments: tuple[str, ...], message: str) -> None:
    ran = multidrop("sniff", *arguments)
    assert ran.status == (5 if "no such port" in message else 2)
    assert message in ran.err


# -- decode ----------------------------------------------------------------------------------------


def test_decode_as_text_json_and_csv(tmp_path: Path) -> None:
    path = str(tmp_path / "a.pcapng")
    busy(Path(path), 100)
    as_json, as_csv, as_text = (
        multidrop("decode", path, *style) for style in (("--json",), ("--csv",), ())
    )
    assert [ran.status for ran in (as_json, as_csv, as_text)] == [0, 0, 0]
    rows = list(csv.DictReader(io.StringIO(as_csv.out)))
    assert len(rows) == len(as_json.objects) == len(as_text.out.splitlines())
    for row, line in zip(rows, as_json.objects, strict=True):
        assert row["time"] == line["time"]
        assert row["value"] == ("" if line["value"] is None else str(line["value"]))
        assert row["error"] == line.get("error", {}).get("kind", "")
    assert as_text.err == as_json.err
    assert "infeed" in as_text.err
    assert multidrop("decode", path, "--quiet").out == ""


def test_decode_of_a_file_with_a_broken_end(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    busy(path, 100)
    path.write_bytes(path.read_bytes()[:-3])
    ran = multidrop("decode", str(path), "--json")
    assert ran.status == 0
    assert len(ran.objects) > 90
    assert "the file is cut short" in ran.err


@pytest.mark.parametrize("content", [b"", b"GIF89a......", bytes.fromhex("d4c3b2a1") + bytes(20)])
def test_decode_of_what_is_no_capture(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(content)
    ran = multidrop("decode", str(path))
    assert (ran.status, ran.out) == (2, "")
    assert "a.bin" in ran.err


def test_decode_into_a_pipe_that_closes(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    busy(path, 3000)
    with running("decode", str(path), "--json") as program:
        program.wait_for('"v": 1')
        assert program.process.stdout is not None
        ran = program.ended()
    assert ran.status == 0


# -- --capture -------------------------------------------------------------------------------------


def test_the_traffic_of_a_command_as_a_capture(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    with tapped("ax-v:2") as (port, _):
        ran = multidrop("read", f"ax-v:2@{port}", "1009", "77", "--capture", str(path))
    assert ran.status == 3
    reader = CaptureReader(path)
    assert [packet.sent for packet in reader.packets()] == [True, False, True, False]
    assert reader.interfaces[0].devices[2].profile == "ax-v"
    read, refused = multidrop("decode", str(path), "--json").objects
    assert (read["name"], read["value"]) == ("ipa_1009", 125)
    assert refused["error"]["code"] == 1


def test_ctrl_c_leaves_a_readable_capture(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    with tapped("ax-v:2") as (port, _):
        arguments = ("read", f"ax-v:2@{port}", "1009", "--every", "0", "--capture", str(path))
        with running(*arguments) as reading:
            reading.wait_for("1009")
            assert reading.interrupt().status == 130
        with running(*arguments) as reading:
            reading.wait_for("1009")
            reading.end()  # SIGKILL
            reader = CaptureReader(path)
            assert len(list(reader.packets())) > 0
            assert reader.ending == ""
    ran = multidrop("decode", str(path), "--json")
    assert ran.objects[0]["value"] == 125
    assert "cut short" not in ran.err


def test_a_capture_that_cannot_be_written_sends_nothing(tmp_path: Path) -> None:
    server = Server(lambda connected: None)
    try:
        ran = multidrop("write", f"ax-v:2@{server.port}", "1111=1", "--capture", str(tmp_path))
    finally:
        server.close()
    assert ran.status == 2
    assert "Is a directory" in ran.err
    assert server.received == b""


def test_the_plant_file_names_the_devices_of_a_capture(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    talk = Talk(path)
    talk.say(question(2, 1))
    talk.say(answer(question(2, 1), 125))
    talk.close()
    (tmp_path / "multidrop.toml").write_text(
        '[line.press]\nport = "/dev/ttyUSB0"\n[line.press.device.winder]\nprofile = "ax-v"\n'
        'address = 2\n[line.press.device.winder.points]\nspeed = { at = "1009", unit = "rpm" }\n'
    )
    ran = multidrop("decode", str(path), "--json", cwd=tmp_path)
    assert (ran.object["name"], ran.object["unit"]) == ("speed", "rpm")
    ran = multidrop("decode", str(path), "--device", "winder", cwd=tmp_path)
    assert "winder" in ran.out
    assert "read speed (1009) = 125 rpm" in ran.out


# -- simulate --from -------------------------------------------------------------------------------


def test_a_capture_is_replayed(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    points = ("1009", "1111", "77")
    with tapped("ax-v:2") as (port, _):
        first = multidrop("read", f"ax-v:2@{port}", *points, "--json", "--capture", str(path))
    with running("simulate", "--from", str(path), "--listen", "tcp://127.0.0.1:0") as replaying:
        port = replaying.wait_for("listening on ").removeprefix("listening on ")
        again = multidrop("read", f"ax-v:2@{port}", *points, "78", "--json")
        said = replaying.interrupt().err
    assert [line.get("raw") for line in again.objects[:3]] == [
        line.get("raw") for line in first.objects
    ]
    assert [line["error"]["code"] for line in again.objects[2:]] == [1, 1]
    assert "learned from slink3 9600 8E1 tcp://" in said
    assert "address 2 (ax-v): 3 questions, 3 answers" in said


def test_what_cannot_be_replayed(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    for arguments, message in (
        (("--from", str(path), "--listen", "pty"), "No such file"),
        (("--from", str(path), "ax-v:1", "--listen", "pty"), "has its own devices"),
        (("--from", str(path)), "where? --listen"),
    ):
        ran = multidrop("simulate", *arguments)
        assert ran.status == 2
        assert message in ran.err
