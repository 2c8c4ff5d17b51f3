"""Backups and differences over HTTP, with a real server on a simulated axis: what it reads, keeps, compares and refuses."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from integration.gateways import Answer, Client, tokens
from integration.processes import PATIENCE, Running, multidrop, running
from integration.threads import served
from multidrop.io.connection import connect
from multidrop.passports.passport import Passport
from multidrop.protocols import ultra3000
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Pace, SimulatedLine

PLANT = """
[line.axis]
port = "{port}"
timeout = 0.3
[line.axis.device.axis]
profile = "ultra3000"
address = 0
[line.axis.device.axis.points]
kp = {{ at = "kp", every = 0.2 }}
[line.axis.device.spare]
profile = "ultra3000"
address = 5
[http]
listen = "127.0.0.1:0"
tokens = "tokens.toml"
[passports]
path = "kept"
most = 6
"""
IMPATIENT = PLANT.replace("timeout = 0.3", "timeout = 0.1")
"""A silent device is probed the more rarely, the longer a probe takes: this one is soon found again."""

POINTS = 319
SLOW = 0.012
"""s for each answer of the axis: its backup takes about four seconds."""


@dataclass
class Site:
    """A gateway in a process of its own, its client, and the line that it polls."""

    client: Client
    reader: str
    folder: Path
    line: SimulatedLine
    port: str
    program: Running

    def post(self, path: str, device: object, **headers: str | None) -> Answer:
        headers.setdefault("content_type", "application/json")
        headers.setdefault("authorization", f"Bearer {self.client.token}")
        return self.client.ask("POST", path, json.dumps({"device": device}).encode(), **headers)

    def reading(self, device: str = "axis") -> dict[str, Any]:
        """The last reading of a device."""
        all_of_them = self.client.get("/api/read-all").json
        (found,) = (item for item in all_of_them if item["device"] == device)
        return dict(found)

    def ended(self, device: str = "axis") -> dict[str, Any]:
        """The reading of a device, once it is over."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            found = self.reading(device)
            if found["state"] != "reading":
                return found
            time.sleep(0.02)
        raise AssertionError("it is read for ever")

    def made(self) -> dict[str, Any]:
        """A passport of the axis, from the beginning to its entry in the list."""
        begun = self.post("/api/passports", "axis")
        assert begun.status == 200, begun.body
        found = self.ended()
        assert found["state"] == "done", found
        listed = self.client.get("/api/passports?device=axis").json
        return next(item for item in listed if item["name"] == found["name"])

    def differences(self, name: str, query: str = "") -> Answer:
        return self.client.get(f"/api/passports/axis/{name}/differences{query}")

    def write(self, point: str, value: float) -> None:
        """At the keypad: the gateway has no part in it."""
        with connect(f"ultra3000:0@{self.port},timeout=1") as axis:
            axis.write(point, value)

    def answers_after(self, seconds: float) -> None:
        """The axis takes so long for each answer from now on."""
        self.line.pace = Pace(answer_delay=seconds)

    def clear(self) -> None:
        """As at the beginning: nothing kept, and a quick axis."""
        self.answers_after(0.0)
        for path in (self.folder / "kept").iterdir():
            path.unlink()


@contextlib.contextmanager
def site_in(folder: Path, plant: str = PLANT) -> Iterator[Site]:
    """A gateway that polls an axis which answers at once."""
    line = SimulatedLine([simulated_device("ultra3000", 0)], ultra3000.decoder)
    with served(line) as place:
        file = folder / "multidrop.toml"
        file.write_text(plant.format(port=place.port), "utf-8")
        writer, reader = tokens(folder)
        with running("run", str(file)) as program:
            url = program.wait_for("http://")
            yield Site(Client(url, writer), reader, folder, line, place.port, program)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with site_in(tmp_path_factory.mktemp("site")) as started:
        yield started


@pytest.fixture
def site(shared: Site) -> Site:
    shared.clear()
    return shared


def test_a_backup_is_read_listed_and_saved(site: Site) -> None:
    begun = site.post("/api/passports", "axis").json
    assert (begun["state"], begun["points"], begun["keep"]) == ("reading", POINTS, True)
    found = site.ended()
    assert (found["done"], found["who"], found["error"]) == (POINTS, "tester", None)
    (listed,) = site.client.get("/api/passports?device=axis").json
    assert listed["name"] == found["name"]
    assert listed["path"] == f"kept/{listed['name']}"
    assert listed["made_as"] == f"ultra3000:0@{site.port}"
    assert (listed["points"] + listed["unreadable"], listed["damage"]) == (POINTS, None)
    file = site.client.get(f"/api/passports/axis/{listed['name']}")
    assert file.headers["content-type"].startswith("application/toml")
    assert file.headers["content-disposition"] == "attachment"
    on_disk = (site.folder / "kept" / listed["name"]).read_bytes()
    assert file.body == on_disk
    assert Passport.from_text(on_disk.decode(), "x").points["0x011"].name == "kp"
    assert f"axis: passport {listed['name']}, made by tester" in site.program.err
    told = [item["device"] for item in site.client.get("/api/status").json["readings"]]
    assert told.count("axis") == 1


def test_the_command_line_takes_what_the_gateway_made(site: Site) -> None:
    """The same points, the same folder: `diff` and `watch-drift` find nothing, then what was changed."""
    name = site.made()["name"]
    file = str(site.folder / "kept" / name)
    device = f"ultra3000:0@{site.port},timeout=1"
    assert multidrop("diff", file, device).out == ""
    shown_on_the_page = ("restore", f"kept/{name}", "axis", "--dry-run")
    restored = multidrop(*shown_on_the_page, cwd=site.folder)
    assert (restored.status, "0 to write" in restored.out) == (0, True), restored.err
    plant = str(site.folder / "multidrop.toml")
    alone = Path(plant).with_name("alone.toml")
    spare = '[line.axis.device.spare]\nprofile = "ultra3000"\naddress = 5\n'
    alone.write_text(Path(plant).read_text("utf-8").replace(spare, ""), "utf-8")
    drift = multidrop("watch-drift", str(alone))
    assert (drift.status, drift.out) == (0, ""), drift.err
    site.write("kp", 7)
    try:
        drift = multidrop("watch-drift", str(alone))
        assert "axis: kp (0x011)   4 -> 7" in drift.out
    finally:
        site.write("kp", 4)


def test_what_the_device_holds_now(site: Site) -> None:
    """Measured points are never compared; setpoints only where somebody wants all."""
    first = site.made()["name"]
    assert site.differences(first).json["differences"] == []
    site.write("kp", 6)
    site.write("position_error_limit", 9000)
    try:
        assert site.post("/api/read-all", "axis", authorization=None).json["who"] is None
        assert (site.ended()["state"], site.ended()["name"]) == ("done", None)
        found = site.differences(first).json
        assert (found["before"]["name"], found["after"]["name"]) == (first, None)
        assert [
            (item["point"], item["name"], item["before"]["value"], item["after"]["value"])
            for item in found["differences"]
        ] == [("0x011", "kp", 4, 6), ("0x018", "position_error_limit", 8000, 9000)]
        assert found["differences"][1]["after"]["unit"] == "counts"
        second = site.made()["name"]
        assert len(site.differences(first, f"?to={second}").json["differences"]) == 2
        assert site.differences(second, f"?to={second}").json["differences"] == []
        assert [item["name"] for item in site.client.get("/api/passports?device=axis").json] == [
            second,
            first,
        ]
    finally:
        site.write("kp", 4)
        site.write("position_error_limit", 8000)


def edited(site: Site, name: str, old: str, new: str, as_name: str) -> None:
    """A copy of a passport with another value and a right checksum, as another tool would make it."""
    text = (site.folder / "kept" / name).read_text("utf-8")
    line = next(line for line in text.splitlines() if line.startswith(f'"{old}"'))
    changed = text.replace(line, new)
    made = Passport.from_text(changed, "x", damaged=True)
    (site.folder / "kept" / as_name).write_text(made.to_text(), "utf-8")


def test_setpoints_only_where_all_are_wanted_and_what_could_not_be_read(site: Site) -> None:
    first = site.made()["name"]
    edited(site, first, "0x06D", '"0x06D" = { name = "setpoint_velocity", role = "setpoint", value = nan, type = "uint32", raw = "1" }', "nan.toml")  # fmt: skip
    assert site.differences("nan.toml", f"?to={first}").json["differences"] == []
    (found,) = site.differences("nan.toml", f"?to={first}&all=true").json["differences"]
    assert (found["role"], found["before"]["value"]) == ("setpoint", None)
    edited(site, first, "0x011", "", "without.toml")
    (found,) = site.differences("without.toml", f"?to={first}").json["differences"]
    assert (found["point"], found["before"], found["after"]["value"]) == ("0x011", None, 4)
    text = (site.folder / "kept" / first).read_text("utf-8")
    unread = text.replace("[unreadable]", '[unreadable]\n"0x9999" = { role = "setting", reason = "no reply" }')  # fmt: skip
    lost = Passport.from_text(unread, "x", damaged=True).to_text()
    (site.folder / "kept" / "lost.toml").write_text(lost, "utf-8")
    (found,) = site.differences(first, "?to=lost.toml").json["differences"]
    assert (found["before"], found["after"]["reason"]) == (None, "no reply")


def test_a_passport_that_was_damaged_by_hand(site: Site) -> None:
    """It is listed with the reason and can be saved, and is never compared."""
    name = site.made()["name"]
    path = site.folder / "kept" / name
    path.write_text(path.read_text("utf-8").replace("value = 4.0", "value = 5.0", 1), "utf-8")
    (site.folder / "kept" / "axis-20261122T023107Z.passport.toml").write_text("passport = 1\n")
    for file in ("tokens.toml", "multidrop.toml"):
        (site.folder / "kept" / file).write_bytes((site.folder / file).read_bytes())
    listed = {item["name"]: item for item in site.client.get("/api/passports?device=axis").json}
    assert set(listed) == {name, "axis-20261122T023107Z.passport.toml"}
    assert "its checksum does not fit" in listed[name]["damage"]
    found = site.differences(name, f"?to={name}")
    assert (found.status, "checksum" in found.reason) == (400, True)
    assert site.client.get(f"/api/passports/axis/{name}").status == 200
    for other in ("axis-20261122T023107Z.passport.toml", "tokens.toml", "multidrop.toml"):
        assert site.client.get(f"/api/passports/axis/{other}").status == 404, other
    (site.folder / "kept" / name).write_text("time = " + "[" * 100_000)
    assert site.client.get(f"/api/passports/axis/{name}").status == 404


@pytest.mark.parametrize(
    "name",
    [
        "..%2Ftokens.toml",
        "../tokens.toml",
        "%2e%2e%2ftokens.toml",
        "..",
        "nothing.toml",
        "%00",
        "kept%2Fx",
    ],
)
def test_no_name_leads_out_of_the_folder(site: Site, name: str) -> None:
    (site.folder / "x.passport.toml").write_text("secret = 1\n")
    site.made()
    for path in (f"/api/passports/axis/{name}", f"/api/passports/axis/{name}/differences"):
        found = site.client.get(path)
        assert (found.status, b"secret" in found.body) == (404, False), path
    assert site.differences(site.made()["name"], f"?to={name}").status == 404


def test_what_makes_no_sense(site: Site) -> None:
    name = site.made()["name"]
    for path, status in (
        ("/api/passports", 400),
        ("/api/passports?device=nobody", 404),
        ("/api/passports?device=axis&more=1", 400),
        (f"/api/passports/nobody/{name}", 404),
        (f"/api/passports/spare/{name}", 404),
        (f"/api/passports/axis/{name}/differences?all=yes", 400),
        (f"/api/passports/axis/{name}/differences?to=nothing", 404),
    ):
        found = site.client.get(path)
        assert (found.status, bool(found.reason)) == (status, True), path
    for path in ("/api/passports", "/api/read-all", "/api/read-all/stop"):
        assert site.post(path, "nobody").status == 404
        assert site.post(path, "../axis").status == 404
        assert site.post(path, 3).status == 400
        assert site.post(path, "axis", content_type="text/plain").status == 415
        assert site.post(path, "axis", origin="http://evil.example").status == 403
        assert site.post(path, "axis", host="evil.example").status == 421
        assert site.client.get("/api/read-all/stop").status == 405
    assert site.post("/api/read-all/stop", "axis").status == 404, "nothing is read"


def test_rights(site: Site) -> None:
    """What leaves a file behind needs the right to write; looking does not."""
    reader = f"Bearer {site.reader}"
    assert site.post("/api/passports", "axis", authorization=None).status == 401
    assert site.post("/api/passports", "axis", authorization=reader).status == 403
    assert site.post("/api/passports", "axis", authorization="Bearer wrong").status == 401
    assert list((site.folder / "kept").iterdir()) == []
    assert site.post("/api/read-all", "axis", authorization=reader).json["who"] == "reader"
    assert site.ended()["state"] == "done"
    assert list((site.folder / "kept").iterdir()) == []


def test_a_device_that_is_not_there(site: Site) -> None:
    assert site.post("/api/passports", "spare").status == 200
    found = site.ended("spare")
    assert found["state"] == "failed"
    assert "no reply" in found["error"]
    assert site.client.get("/api/passports?device=spare").json == []


def test_no_more_than_the_plant_file_lets_be_kept(site: Site) -> None:
    """And none is deleted."""
    for _ in range(6):
        site.made()
    found = site.post("/api/passports", "axis")
    assert (found.status, found.json["error"]["kind"]) == (503, "not-kept")
    assert "6 passports of axis already" in found.reason
    assert len(list((site.folder / "kept").iterdir())) == 6


def test_a_folder_that_takes_nothing(site: Site) -> None:
    """It became a file while somebody was looking."""
    kept = site.folder / "kept"
    kept.rmdir()
    kept.write_text("in the way")
    try:
        assert site.client.get("/api/passports?device=axis").status == 503
        found = site.post("/api/passports", "axis")
        assert (found.status, "kept" in found.reason) == (503, True), found.body
        assert site.post("/api/read-all", "axis").status == 200, "looking needs no folder"
        assert site.ended()["state"] == "done"
    finally:
        kept.unlink()
        kept.mkdir()


# -- on a slow line ------------------------------------------------------------------------------


@pytest.fixture
def slow(site: Site) -> Iterator[Site]:
    site.answers_after(SLOW)
    yield site
    if site.reading()["state"] == "reading":
        site.post("/api/read-all/stop", "axis")


def under_way(site: Site) -> None:
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        found = site.reading()
        if found["state"] == "reading" and found["done"] > 5:
            return
        time.sleep(0.01)
    raise AssertionError(found)


def test_polls_go_on_while_it_is_read(slow: Site) -> None:
    slow.answers_after(SLOW / 2)
    before = slow.client.get("/api/status").json["lines"][0]["missed"]
    with slow.client.stream("/api/events?device=axis") as events:
        started = slow.post("/api/read-all", "axis").json["started"]
        seen = 0
        for name, data in events:
            if name == "values":
                assert all(item["quality"] == "good" for item in data)
                seen += 1
            if name == "status" and any(
                (item["started"], item["state"]) == (started, "done") for item in data["readings"]
            ):
                break
    assert seen >= 5
    assert slow.client.get("/api/status").json["lines"][0]["missed"] == before


def test_two_at_once(slow: Site) -> None:
    assert slow.post("/api/passports", "axis").status == 200
    for path in ("/api/passports", "/api/read-all"):
        found = slow.post(path, "axis")
        assert (found.status, found.json["error"]["kind"]) == (409, "busy")
    slow.answers_after(0.0)
    assert slow.ended()["state"] == "done"
    assert len(slow.client.get("/api/passports?device=axis").json) == 1


def test_it_can_be_stopped_by_whom_could_have_begun_it(slow: Site) -> None:
    assert slow.post("/api/passports", "axis").status == 200
    under_way(slow)
    found = slow.post("/api/read-all/stop", "axis", authorization=f"Bearer {slow.reader}")
    assert found.status == 403
    stopped = slow.post("/api/read-all/stop", "axis").json
    assert stopped["state"] == "stopped"
    assert stopped["done"] < POINTS
    assert list((slow.folder / "kept").iterdir()) == []


def test_a_device_that_falls_silent_in_the_middle(tmp_path: Path) -> None:
    """No file, and the others are polled on; when it is back all is as before."""
    with site_in(tmp_path, plant=IMPATIENT) as site:
        site.answers_after(SLOW)
        assert site.post("/api/passports", "axis").status == 200
        under_way(site)
        device = site.line.devices.pop()
        found = site.ended()
        site.line.devices.append(device)
        assert (found["state"], "no reply" in found["error"]) == ("failed", True), found
        assert list((tmp_path / "kept").iterdir()) == []
        until = time.monotonic() + PATIENCE
        while site.client.get("/api/values/axis/kp").json["quality"] != "good":
            assert time.monotonic() < until
            time.sleep(0.05)


def test_a_disk_that_is_full_at_the_end(slow: Site) -> None:
    """The folder is gone when the file should be written."""
    assert slow.post("/api/passports", "axis").status == 200
    under_way(slow)
    (slow.folder / "kept").rename(slow.folder / "elsewhere")
    slow.answers_after(0.0)
    try:
        found = slow.ended()
    finally:
        (slow.folder / "elsewhere").rename(slow.folder / "kept")
    assert (found["state"], "cannot be written" in found["error"]) == ("failed", True), found
    assert found["name"] is None


def test_a_plant_file_that_was_read_again(slow: Site) -> None:
    """Another device at the same place is not read on under the old name."""
    assert slow.post("/api/passports", "axis").status == 200
    under_way(slow)
    file = slow.folder / "multidrop.toml"
    text = file.read_text("utf-8")
    file.write_text(text.replace("address = 0", "address = 1"), "utf-8")
    try:
        slow.program.process.send_signal(signal.SIGHUP)
        found = slow.ended()
        assert (found["state"], "read again" in found["error"]) == ("failed", True), found
    finally:
        file.write_text(text, "utf-8")
        slow.program.process.send_signal(signal.SIGHUP)
        for _ in range(2):
            slow.program.wait_for("reloaded: changed axis")
    assert list((slow.folder / "kept").iterdir()) == []


def test_a_gateway_that_is_ended_meanwhile(tmp_path: Path) -> None:
    with site_in(tmp_path) as site:
        site.answers_after(SLOW)
        assert site.post("/api/passports", "axis").status == 200
        under_way(site)
        ended = site.program.interrupt()
        assert ended.status == 130, ended.err
        assert "Traceback" not in ended.err
        assert os.listdir(tmp_path / "kept") == []


def test_a_gateway_that_keeps_none(tmp_path: Path) -> None:
    plant = PLANT.partition("[passports]")[0]
    with site_in(tmp_path, plant=plant) as site:
        found = site.client.get("/api/passports?device=axis")
        assert (found.status, "[passports]" in found.reason) == (404, True)
        assert site.post("/api/passports", "axis").status == 404
        assert site.client.get("/api/read-all").json == []
        assert site.client.get("/api/status").json["readings"] == []


def test_a_port_that_is_away(tmp_path: Path) -> None:
    with site_in(tmp_path, plant=PLANT.replace('"{port}"', '"tcp://127.0.0.1:1"')) as site:
        for path in ("/api/passports", "/api/read-all", "/api/status"):
            found = site.post(path, "axis")
            assert (found.status, found.json["error"]["kind"]) == (503, "port"), found.body
        assert site.client.get("/api/read-all").json == []


def test_how_a_device_is_by_name(site: Site) -> None:
    found = site.post("/api/status", "axis", authorization=None)
    assert found.status == 200, found.body
    assert any(line.split() == ["faults", "none"] for line in found.json["lines"])
    assert site.post("/api/status", "spare").status == 504
    assert site.post("/api/status", "nobody").status == 404


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("in the way")
    plant = PLANT.replace('path = "kept"', 'path = "kept/deeper"')
    (tmp_path / "multidrop.toml").write_text(plant.format(port="tcp://127.0.0.1:1"), "utf-8")
    tokens(tmp_path)
    ran = multidrop("run", str(tmp_path / "multidrop.toml"))
    assert (ran.status, str(tmp_path / "kept" / "deeper") in ran.err) == (2, True), ran.err
