"""`read`, `status`, `watch`, `ports`, `profiles`, `points` in processes of their own."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from integration.processes import (
    COMMAND,
    Address,
    Simulator,
    environment,
    multidrop,
    running,
    simulator,
)
from integration.servers import Connected, answering, reply_to, serving
from integration.ways import state_of
from multidrop.protocols.slink3 import Frame

READING = ["v", "device", "point", "name", "value", "unit", "type", "raw", "fault", "time", "ms"]


def test_a_reading_for_a_person(plant: Simulator) -> None:
    ran = multidrop("read", plant.device("ax-v:2"), "1009", "1111:int16")
    assert (ran.status, ran.err) == (0, "")
    first, second = ran.out.splitlines()
    assert re.fullmatch(r"ipa_1009 \(1009\) +125 +int16 +7D ?00 +\d+\.\d ms", first)
    assert re.fullmatch(r"ipa_1111 \(1111\) +100 +int16 +64 ?00 +\d+\.\d ms", second)


def test_a_reading_as_json(plant: Simulator) -> None:
    before = datetime.now(UTC)
    ran = multidrop("read", plant.device("slink3:2", broadcast=128), "1009", "--json")
    assert (ran.status, ran.err) == (0, "")
    found = ran.object
    assert list(found) == READING
    time = datetime.fromisoformat(found.pop("time"))
    assert before - timedelta(seconds=1) <= time <= datetime.now(UTC)
    assert 0 < found.pop("ms") < 5000
    assert found == {
        "v": 1,
        "device": f"slink3:2@{plant.port}",
        "point": "1009",
        "name": None,
        "value": 125,
        "unit": None,
        "type": "int16",
        "raw": "7d00",
        "fault": False,
    }


def test_a_named_point_has_its_name_and_unit(plant: Simulator) -> None:
    found = multidrop("read", plant.device("flexmax:0"), "actual_speed", "--json").object
    assert (found["name"], found["point"]) == ("actual_speed", "std/0x6044.0")
    assert (found["unit"], found["value"], found["fault"]) == ("rpm", 0, False)


def test_the_fault_bit_is_null_where_there_is_none(plant: Simulator) -> None:
    assert multidrop("read", plant.device("ax-v:2"), "1009", "--json").object["fault"] is None


def test_the_card_behind_a_drive(plant: Simulator) -> None:
    ran = multidrop("read", plant.device("flexmax:0"), "dgfc/511:uint8", "dest2/511", "--json")
    assert [found["value"] for found in ran.objects] == [0, 0]
    assert [found["point"] for found in ran.objects] == ["dgfc/511", "dgfc/511"]


def test_all_points_are_tried_and_the_highest_status_counts(plant: Simulator) -> None:
    ran = multidrop("read", plant.device("flexmax:1"), "9999:int16", "8236", "8237", "--json")
    assert ran.status == 3
    first, second, third = ran.objects
    assert first == {
        "v": 1,
        "device": f"flexmax:1@{plant.port}",
        "point": "9999",
        "error": {"kind": "refused", "code": 1, "text": "parameter does not exist"},
    }
    assert second["value"] == 0
    assert third["error"]["code"] == 1


def test_a_refusal_for_a_person(plant: Simulator) -> None:
    ran = multidrop("read", plant.device("flexmax:1"), "9999:int16")
    assert (ran.status, ran.out) == (3, "")
    assert ran.err == "9999: refused with code 0001h: parameter does not exist\n"


def test_no_reply(plant: Simulator) -> None:
    device = plant.device("flexmax:99", timeout=0.05, attempts=2)
    ran = multidrop("read", device, "8236", "--json")
    assert ran.status == 4
    assert ran.object["error"] == {"kind": "no-reply", "text": "no reply in 2 attempts"}
    ran = multidrop("read", device, "8236")
    assert (ran.status, ran.out) == (4, "")
    assert "no reply in 2 attempts\n  check address, baud rate, format and wiring" in ran.err


def test_a_reply_that_breaks_the_protocol() -> None:
    def too_wide(request: Frame) -> Frame:
        return reply_to(request, 0, b"\x03\xf1\x03\x01\x02\x03")

    with answering(too_wide) as server:
        ran = multidrop("read", f"ax-v:2@{server.port}", "1009", "--json")
    assert ran.status == 6
    assert ran.object["error"]["kind"] == "protocol"
    assert "has 2 bytes, the slave sent 3 (bytes 01 02 03)" in ran.object["error"]["text"]


@pytest.mark.parametrize(
    ("answer", "value", "raw"),
    [
        (b"\x08\x01\x00" + bytes.fromhex("0000c07f"), None, "0000c07f"),
        (b"\x08\x01\x00" + bytes.fromhex("000080ff"), None, "000080ff"),
        (b"\x08\x01\x00" + bytes.fromhex("0000c03f"), 1.5, "0000c03f"),
        (b"\x09\x01\x00Gr\xf6\xdfe\0\0", "Größe", "4772f6df650000"),
        (b"\x01\x01\x00\x01", True, "01"),
        (b"\x0a\x01\x00\xff\x00", "ff00", "ff00"),
    ],
    ids=["nan", "infinity", "number", "string", "bool", "bytes"],
)
def test_values_of_every_kind_as_json(answer: bytes, value: object, raw: str) -> None:
    with answering(lambda request: reply_to(request, 0, answer)) as server:
        ran = multidrop("read", f"slink3:0@{server.port}", "1:auto", "--json")
    assert ran.status == 0
    assert (ran.object["value"], ran.object["raw"]) == (value, raw)


def test_every_point_has_its_line_when_the_port_is_lost() -> None:
    def one_answer(line: Connected) -> None:
        request = next(line.requests())
        line.send(reply_to(request, 0, b"\x03\xf1\x03\x07\x00").encode())

    with serving(one_answer) as server:
        ran = multidrop("read", f"ax-v:2@{server.port}", "1009", "1111", "1234:int16", "--json")
    assert ran.status == 5
    first, second, third = ran.objects
    assert first["value"] == 7
    assert second["error"]["kind"] == third["error"]["kind"] == "port"


def test_a_trace_goes_to_standard_error_alone(plant: Simulator) -> None:
    ran = multidrop("read", plant.device("ax-v:2"), "1009", "--json", "--trace")
    assert ran.status == 0
    assert ran.object["value"] == 125
    sent, received = ran.err.splitlines()
    assert re.search(r"> 01 02 00 0B 00 26 00 03 F1 03 DE +\| 2 #0 read typed parameter 1009", sent)
    assert re.search(
        r"< 01 02 00 0D 01 00 00 03 F1 03 7D 00 82 +\| 2 #0 OK 1009:int16 = 125", received
    )


def test_a_trace_shows_damage() -> None:
    with simulator("ax-v:2", "--fault", "wrong-checksum=100%") as bad:
        ran = multidrop(
            "read", bad.device("ax-v:2", timeout=0.1, silence=0.05, attempts=1), "1009", "--trace"
        )
    assert ran.status == 4
    assert re.search(r"< 01 02 00 0D .* \| ! checksum", ran.err)
    assert "bytes come, but damaged: check baud rate and format" in ran.err


def test_a_device_in_fault(fresh: Address) -> None:
    device = fresh.device("flexmax:0")
    assert multidrop("write", device, "65000:uint16=0x2310", "--yes").status == 0
    ran = multidrop("read", device, "8236")
    assert ran.status == 0
    assert f"the device is in fault: multidrop status {device}" in ran.err
    assert multidrop("read", device, "8236", "--json").object["fault"] is True


def test_a_type_that_has_to_be_found(plant: Simulator) -> None:
    found = multidrop("read", plant.device("flexmax:1"), "8511", "24641", "--json").objects
    assert [item["type"] for item in found] == ["uint16", "uint16"]


def test_repeated_until_ctrl_c(plant: Simulator) -> None:
    with running("read", plant.device("ax-v:2"), "1009", "--every", "0.01", "--json") as reading:
        for _ in range(5):
            assert json.loads(reading.wait_for("1009"))["value"] == 125
        ran = reading.interrupt()
    assert ran.status == 130
    assert ran.err.strip() == "interrupted"


@pytest.mark.parametrize("arguments", [("read", "--every", "0.01"), ("watch", "--every", "0.01")])
def test_whoever_reads_the_output_goes(plant: Simulator, arguments: tuple[str, ...]) -> None:
    command, *options = arguments
    process = subprocess.Popen(
        [COMMAND, command, plant.device("ax-v:2"), "1009", *options, "--json"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    )
    assert process.stdout is not None
    assert process.stderr is not None
    with process:
        assert "1009" in process.stdout.readline()
        process.stdout.close()
        assert process.wait(20) == 0
        assert process.stderr.read() == ""


def test_status_of_a_drive(plant: Simulator) -> None:
    ran = multidrop("status", plant.device("flexmax:1"))
    assert ran.status == 0
    assert "state              switch-on disabled" in ran.out
    assert "malfunction code   0000h" in ran.out
    found = multidrop("status", plant.device("flexmax:1"), "--json").object
    assert found["device"] == f"flexmax:1@{plant.port}"
    assert (found["v"], found["fault"], found["status_word"]) == (1, False, 0x0240)
    assert (found["state"], found["malfunction_code"]) == ("switch-on disabled", 0)


def test_status_of_what_has_none(plant: Simulator) -> None:
    ran = multidrop("status", plant.device("ax-v:2"))
    assert (ran.status, ran.out) == (2, "")
    assert "ax-v has no status word" in ran.err


def test_status_of_a_card() -> None:
    with simulator("dgfc386:3") as direct:
        found = multidrop("status", direct.device("dgfc386:3"), "--json").object
    assert (found["fault"], found["status_word"]) == (False, None)


def test_watch_prints_each_change_without_a_terminal(fresh: Address) -> None:
    device = fresh.device("flexmax:0")
    with running("watch", device, "8236", "8511", "--every", "0.02") as watching:
        assert re.fullmatch(r"\d\d:\d\d:\d\d   index_8236 \(8236\) +0", watching.wait_for("8236"))
        watching.wait_for("8511")
        assert multidrop("write", device, "8236=77").status == 0
        assert watching.wait_for("8236").endswith(" 77")
        ran = watching.interrupt()
    assert ran.status == 130
    assert len(ran.out.splitlines()) == 3
    assert ran.err.strip() == "interrupted"


def test_watch_shows_what_cannot_be_read_and_goes_on(plant: Simulator) -> None:
    with running(
        "watch", plant.device("flexmax:1"), "9999:int16", "8236", "--every", "0.02"
    ) as one:
        assert "parameter does not exist" in one.wait_for("9999")
        one.wait_for("8236")
        assert one.interrupt().status == 130


def test_watch_as_json(plant: Simulator) -> None:
    with running("watch", plant.device("ax-v:2"), "1009", "--every", "0.02", "--json") as watching:
        for _ in range(2):
            assert list(json.loads(watching.wait_for("1009"))) == READING
        assert watching.interrupt().status == 130


def test_watch_without_points(plant: Simulator) -> None:
    ran = multidrop("watch", plant.device("ax-v:2"))
    assert ran.status == 2
    assert "which points?" in ran.err


def test_ports() -> None:
    ran = multidrop("ports")
    assert ran.status == 0
    assert ran.out or "no serial ports on this machine" in ran.err
    as_json = multidrop("ports", "--json")
    assert as_json.status == 0
    assert all(line["v"] == 1 for line in as_json.objects)


def test_profiles() -> None:
    ran = multidrop("profiles")
    assert ran.status == 0
    assert {"flexmax", "ax-v", "dgfc386", "slink3"} <= {
        line.split()[0] for line in ran.out.splitlines() if line.strip()
    }
    found = {line["name"]: line for line in multidrop("profiles", "--json").objects}
    assert found["slink3"]["points"] == 0
    assert found["ax-v"]["protocol"] == "slink3"


def test_points_of_a_profile() -> None:
    ran = multidrop("points", "flexmax", "speed")
    assert ran.status == 0
    assert "speed_setpoint" in ran.out
    assert "malfunction" not in ran.out
    found = multidrop("points", "flexmax", "--json").objects
    assert {line["name"] for line in found} >= {"control_word", "address", "index_8236"}
    assert all(line["profile"] == "flexmax" and line["source"] for line in found)
    assert "no point of flexmax mentions 'xyz'" in multidrop("points", "flexmax", "xyz").err
    unknown = multidrop("points", "flexmx")
    assert unknown.status == 2
    assert "did you mean 'flexmax'" in unknown.err


def test_a_device_of_the_plant_file(plant: Simulator, tmp_path: Path) -> None:
    (tmp_path / "multidrop.toml").write_text(
        f"""
        [line.press]
        port = "{plant.port}"
        timeout = 0.8
        [line.press.device.infeed]
        profile = "ax-v"
        address = 2
        [line.press.device.infeed.points]
        tension = {{ at = "1009:int16", unit = "N", scale = 0.1 }}
        """
    )
    found = multidrop("read", "infeed", "tension", "--json", cwd=tmp_path).object
    assert found["device"] == f"ax-v:2@{plant.port}"
    assert (found["name"], found["point"], found["unit"]) == ("tension", "1009", "N")
    assert found["value"] == pytest.approx(12.5)
    assert found["raw"] == "7d00"
    with running("watch", "infeed", cwd=tmp_path) as watching:
        assert "12.5 N" in watching.wait_for("tension")
        assert watching.interrupt().status == 130
    unknown = multidrop("read", "infed", "tension", cwd=tmp_path)
    assert unknown.status == 2
    assert "has no device 'infed' - did you mean 'infeed'" in unknown.err
    elsewhere = multidrop("read", "infeed", "1009", "--config", str(tmp_path / "multidrop.toml"))
    assert elsewhere.status == 0


def test_a_profile_of_ones_own(plant: Simulator, tmp_path: Path) -> None:
    own = tmp_path / "mine.toml"
    own.write_text(
        '[profile]\nname = "mine"\nprotocol = "slink3"\ndialect = "ax-v"\n'
        '[points.tension]\nat = "1009:int16"\nrole = "measured"\n'
    )
    ran = multidrop("read", plant.device("ax-v:2"), "tension", "--profile", str(own), "--json")
    assert ran.object["name"] == "tension"
    own.write_text('[profile]\nname = "mine"\nprotocoll = "slink3"\n')
    ran = multidrop("read", plant.device("ax-v:2"), "tension", "--profile", str(own))
    assert ran.status == 2
    assert "unknown key 'protocoll' - did you mean 'protocol'" in ran.err


def test_keys_as_options_and_behind_the_device(plant: Simulator) -> None:
    device = plant.device("flexmax:99", timeout=3)
    options = ("--timeout", "0.05", "--attempts", "1", "--baud", "19200", "--format", "8N1")
    ran = multidrop("read", device, "8236", "--json", *options)
    assert ran.object["error"]["text"] == "no reply in 1 attempt"


def test_ctrl_c_while_an_answer_is_awaited(plant: Simulator) -> None:
    with running("read", plant.device("flexmax:99", timeout=60), "8236", "--trace") as reading:
        reading.wait_for(">")
        ran = reading.interrupt()
    assert ran.status == 130
    assert "Traceback" not in ran.err


def test_the_demo_without_a_terminal() -> None:
    with running("demo", "--terminal", "--listen", "tcp://127.0.0.1:0") as demo:
        port = demo.wait_for("listening on ").removeprefix("listening on ")
        demo.wait_for("actual_speed")
        assert state_of(f"flexmax:1@{port}") == "operation enabled"
        demo.wait_for("actual_speed")  # it has loaded all that it needs by now
        ran = demo.interrupt()
    assert ran.status == 130
    assert ran.err.strip() == "interrupted"


def test_the_demo_ends_by_itself() -> None:
    ran = multidrop("demo", "--terminal", "--listen", "tcp://127.0.0.1:0", "--seconds", "0.3")
    assert (ran.status, ran.err) == (0, "")
    assert "multidrop status flexmax:3@tcp://127.0.0.1:" in ran.out


def test_nothing_is_left_behind(plant: Simulator) -> None:
    """A reader that is killed leaves the simulated line as it was."""
    with running("read", plant.device("ax-v:2"), "1009", "--every", "0.01") as reading:
        reading.wait_for("1009")
        reading.end(signal.SIGKILL)
    assert multidrop("read", plant.device("ax-v:2"), "1009").status == 0
    assert not os.path.exists("multidrop.toml")


@pytest.mark.parametrize(
    ("options", "ready"),
    [(("--terminal",), "axis motor_position"), (("--http", "127.0.0.1:0"), "http://127.0.0.1:")],
)
def test_the_demo_ends_with_its_terminal(
    options: tuple[str, ...], ready: str, tmp_path: Path
) -> None:
    """A window that is closed leaves no plant behind, and no files."""
    asked = ("demo", "--listen", "tcp://127.0.0.1:0", *options)
    with running(*asked, TMPDIR=str(tmp_path)) as demo:
        demo.wait_for(ready)
        ran = demo.end(signal.SIGHUP)
    assert ran.status == 130
    assert "Traceback" not in ran.err
    assert list(tmp_path.iterdir()) == []
