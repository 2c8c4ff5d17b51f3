"""The gateway over HTTP, with a real server: what it answers, and above all what it refuses."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from programs import program

from integration.gateways import PLANT, Answer, Client, RunningGateway, gateway
from integration.processes import PATIENCE, multidrop


@pytest.fixture(scope="module")
def running_gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningGateway]:
    """One for all tests of this module; its audit log is its own."""
    folder = tmp_path_factory.mktemp("gateway")
    before = os.environ.get("MULTIDROP_AUDIT")
    os.environ["MULTIDROP_AUDIT"] = str(folder / "audit.jsonl")
    try:
        with gateway(
            folder, '[faults]\npath = "faults"\n[history]\npath = "history.db"\n'
        ) as started:
            yield started
    finally:
        if before is None:
            del os.environ["MULTIDROP_AUDIT"]
        else:
            os.environ["MULTIDROP_AUDIT"] = before


@pytest.fixture
def client(running_gateway: RunningGateway) -> Client:
    return running_gateway.client


def audit_of(started: RunningGateway) -> list[dict[str, Any]]:
    path = started.folder / "audit.jsonl"
    return [json.loads(line) for line in path.read_text("utf-8").splitlines() if line]


def value_of(client: Client, path: str) -> Any:
    """The latest value, once there is one."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        found = client.get(f"/api/values/{path}")
        if found.status == 200 and found.json["quality"] == "good":
            return found.json
        time.sleep(0.05)
    raise AssertionError(found)


# -- what it answers -----------------------------------------------------------------------------


def test_the_plant(client: Client) -> None:
    (line,) = client.get("/api/plant").json["lines"]
    assert line["name"] == "press"
    infeed, press = line["devices"]
    assert (infeed["profile"], infeed["address"], press["name"]) == ("flexmax", 0, "press")
    points = {point["name"]: point for point in infeed["points"]}
    assert points["feed"]["write"] == {"min": 0, "max": 150, "rate": 0.0, "motion": False}
    assert points["control"]["write"]["motion"] is True
    assert points["speed"]["write"] is None
    assert points["speed"]["unit"] == "rpm"


def test_values_and_status(client: Client) -> None:
    found = value_of(client, "infeed/speed")
    assert (found["value"], found["fault"], found["error"]) == (0, False, None)
    assert found["time"] <= found["checked"]  # the one is the answer, the other when it was taken
    value_of(client, "press/speed")
    everything = client.get("/api/values").json
    assert {item["device"] for item in everything} == {"infeed", "press"}
    some = client.get("/api/values?device=press").json
    assert {item["device"] for item in some} == {"press"}
    status = client.get("/api/status").json
    assert status["lines"][0]["lost"] is None
    assert 0 < status["lines"][0]["planned"] < 1
    assert [device["silent"] for device in status["devices"]] == [False, False]
    assert status["troubles"] == []
    assert client.get("/health").json == {
        "status": "ok",
        "lines_lost": 0,
        "parts": {"history": "ok"},
    }


def test_a_point_is_read_at_once(client: Client) -> None:
    body = json.dumps({"device": "infeed", "point": "speed"}).encode()
    found = client.ask("POST", "/api/read", body, content_type="application/json")
    assert found.status == 200, found.body
    assert (found.json["value"], found.json["unit"], found.json["raw"]) == (0, "rpm", "0000")


def test_metrics(client: Client) -> None:
    value_of(client, "infeed/speed")
    found = client.get("/metrics")
    assert found.headers["content-type"].startswith("text/plain; version=0.0.4")
    lines = found.body.decode().splitlines()
    assert 'multidrop_line_up{line="press"} 1.0' in lines
    assert 'multidrop_device_up{device="infeed",line="press"} 1.0' in lines
    assert 'multidrop_point_value{device="infeed",point="speed",unit="rpm"} 0.0' in lines
    for line in lines:
        name = line.split("{")[0].split(" ")[2 if line.startswith("#") else 0]
        assert name.startswith("multidrop_"), line


def test_values_as_they_come(client: Client) -> None:
    with client.stream("/api/events?device=infeed") as events:
        seen: dict[str, int] = {}
        for name, data in events:
            seen[name] = seen.get(name, 0) + 1
            if name == "values":
                assert {item["device"] for item in data} == {"infeed"}
            if seen.get("values", 0) > 5 and seen.get("status", 0) > 1:
                break


def test_a_hundred_listeners(client: Client) -> None:
    """All of them hear what is new, those who never read harm nobody, and no poll is left out."""
    before = client.get("/api/status").json["lines"][0]
    with contextlib.ExitStack() as opened:
        streams = [opened.enter_context(client.stream("/api/events")) for _ in range(100)]
        value = 100 + before["counters"]["requests"] % 40
        assert client.write("infeed", "feed", value).status == 200
        for events in streams[::10]:
            for name, data in events:
                if name == "values" and any(item["value"] == value for item in data):
                    break
        after = client.get("/api/status").json["lines"][0]
    assert after["missed"] == before["missed"]
    assert after["counters"]["no_reply"] == 0
    assert after["counters"]["answers"] > before["counters"]["answers"]


def test_a_write_is_seen_by_those_who_listen(client: Client) -> None:
    with client.stream("/api/events") as events:
        next(events)
        assert client.write("infeed", "feed", 77).status == 200
        for name, data in events:
            if name == "values" and any(
                (item["point"], item["value"]) == ("feed", 77) for item in data
            ):
                break


def test_frames_as_they_pass(client: Client) -> None:
    with client.stream("/api/lines/press/frames") as events:
        for _, data in events:
            for transaction in data["transactions"]:
                assert transaction["kind"] == "read", transaction
                assert transaction["device"] in ("infeed", "press")
                assert [frame["sent"] for frame in transaction["frames"]] == [True, False]
                assert (
                    bytes.fromhex(transaction["frames"][0]["shown"]).hex()
                    == (transaction["frames"][0]["raw"])
                )
            if len(data["transactions"]) > 2:
                break
    assert "8236" in str(data) or "speed" in str(data)


def test_the_page_and_its_files(client: Client) -> None:
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert b"<script>" not in page.body
    for path in ("style.css", "app.js", "uplot/uPlot.iife.min.js", "uplot/LICENSE", "icon.svg"):
        found = client.get(f"/{path}")
        assert found.status == 200, path
        assert found.headers["x-content-type-options"] == "nosniff"


def test_nothing_outside_the_page_is_served(client: Client) -> None:
    for path in ("/../server.py", "/%2e%2e/server.py", "/..%2fserver.py", "//etc/passwd", "/api"):
        assert client.get(path).status == 404, path


def test_the_document_describes_what_is_served(client: Client) -> None:
    document = client.get("/openapi.json").json
    for path in ("/health", "/metrics", "/api/plant", "/api/status", "/api/values", "/api/rights"):
        answer = document["paths"][path]["get"]["responses"]["200"]
        kind = client.get(path).headers["content-type"].partition(";")[0]
        assert list(answer["content"]) == [kind]
    assert document["paths"]["/api/write"]["post"]["security"] == [{"token": []}]


# -- what was ------------------------------------------------------------------------------------


def kept_of(client: Client, path: str) -> Any:
    """History, once there is some: it is written once a second."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        found = client.get(path)
        assert found.status == 200, found.body
        if found.headers["content-type"].startswith("text/csv") or found.json["time"]:
            return found
        time.sleep(0.1)
    raise AssertionError(found.body)


def test_history_in_buckets_and_as_csv(client: Client) -> None:
    start = time.time() - 3600
    for value in (33, 44):
        assert client.write("infeed", "feed", value).status == 200
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        path = f"/api/history/infeed/feed?start={start:.3f}&end={time.time() + 60:.3f}&most=500"
        found = kept_of(client, path).json
        if found["last"][-1] == 44:
            break
        time.sleep(0.1)
    assert found["last"][-1] == 44
    assert {len(column) for column in found.values()} == {len(found["time"])}
    assert len(found["time"]) <= 500
    assert max(value for value in found["maximum"] if value is not None) >= 44
    name = f"/api/history.csv?point=infeed/feed&start={start:.3f}&end={time.time() + 60:.3f}"
    rows = kept_of(client, name).body.decode().splitlines()
    assert rows[0] == "device,point,time,value,quality"
    assert rows[-1].startswith("infeed,feed,20")
    assert rows[-1].endswith(",44,good")


def test_a_time_that_is_iso(client: Client) -> None:
    path = "/api/history/infeed/feed?start=2026-01-01T00:00:00Z&end=2026-01-02T00:00:00%2B01:00"
    assert client.get(path).json["time"] == []


# -- writing -------------------------------------------------------------------------------------


def test_a_write(running_gateway: RunningGateway) -> None:
    client = running_gateway.client
    assert client.write("infeed", "feed", 0).status == 200
    found = client.write("infeed", "feed", 12.5)
    assert found.status == 200, found.body
    assert {name: found.json[name] for name in ("old", "asked", "found", "outcome")} == {
        "old": 0,
        "asked": 12.5,
        "found": 12.5,
        "outcome": "confirmed",
    }
    last = audit_of(running_gateway)[-1]
    assert (last["who"], last["from"]) == ("tester", "http 127.0.0.1")
    assert (last["asked"], last["outcome"]) == (12.5, "confirmed")


@pytest.mark.parametrize(
    ("point", "value", "status", "reason"),
    [
        ("speed", 1, 403, "may not be written"),
        ("feed", 151, 400, "out of range"),
        ("feed", -0.1, 400, "out of range"),
        ("feed", float("nan"), 400, "no value"),
        ("feed", float("inf"), 400, "out of range"),
        ("feed", "12", 400, "not a number"),
        ("feed", None, 400, "not a number"),
        ("feed", True, 400, "not a number"),
        ("feed", [1], 400, "not a number"),
        ("nothing", 1, 404, "no point"),
    ],
)
def test_a_write_that_is_not_allowed(
    client: Client, point: str, value: object, status: int, reason: str
) -> None:
    assert client.write("infeed", "feed", 5).status == 200
    found = client.write("infeed", point, value)
    assert (found.status, reason in found.reason) == (status, True), found.body
    assert client.write("infeed", "feed", 5).json["old"] == 5


def test_a_refused_write_is_in_the_audit_log(running_gateway: RunningGateway) -> None:
    assert running_gateway.client.write("infeed", "feed", 151).status == 400
    last = audit_of(running_gateway)[-1]
    assert (last["who"], last["asked"], last["outcome"]) == ("tester", 151, "not-sent")


def test_two_writes_too_near(client: Client) -> None:
    assert client.write("infeed", "slow", 10).status == 200
    found = client.write("infeed", "slow", 11)
    assert found.status == 403
    assert "every 60 s" in found.reason


UNTOUCHED = 5.0


def refused(client: Client, status: int, reason: str, **headers: str | None) -> None:
    """A write with these headers is refused, and nothing was written."""
    assert client.write("infeed", "feed", UNTOUCHED).status == 200
    found = client.write("infeed", "feed", 99, **headers)
    assert (found.status, reason in found.reason) == (status, True), (found.status, found.body)
    assert client.write("infeed", "feed", UNTOUCHED).json["old"] == UNTOUCHED


def test_writing_needs_a_token(running_gateway: RunningGateway) -> None:
    client, reader = running_gateway.client, running_gateway.reader
    refused(client, 401, "a token", authorization=None)
    refused(client, 401, "not known", authorization="Bearer wrong")
    refused(client, 401, "not known", authorization="Bearer ")
    refused(client, 401, "not known", authorization=f"Basic {client.token}")
    refused(client, 401, "not known", authorization=f"Bearer {client.token}x")
    refused(client, 403, "no right to write", authorization=f"Bearer {reader}")
    found = client.ask(
        "POST", "/api/write", b"{}", content_type="application/json", authorization=None
    )
    assert found.headers["www-authenticate"] == "Bearer"


def test_a_wrong_token_does_not_read_either(client: Client) -> None:
    assert client.get("/api/values", authorization="Bearer wrong").status == 401
    assert client.get("/api/values").status == 200


def test_rights(running_gateway: RunningGateway) -> None:
    client = running_gateway.client
    assert client.get("/api/rights").json == {"name": None, "rights": ["read"]}
    mine = client.get("/api/rights", authorization=f"Bearer {client.token}").json
    assert mine == {"name": "tester", "rights": ["read", "write"]}


@pytest.mark.parametrize(
    "kind",
    [
        None,
        "",
        "text/plain",
        "application/x-www-form-urlencoded",
        "multipart/form-data; boundary=x",
    ],
)
def test_only_json_is_taken(client: Client, kind: str | None) -> None:
    refused(client, 415, "application/json", content_type=kind)


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "ftp://{host}",
        "http://127.0.0.1:1",
        "http://{host}.evil.example",
    ],
)
def test_other_sites_are_refused(client: Client, origin: str) -> None:
    host = f"{client.host}:{client.port}"
    refused(client, 403, "other sites", origin=origin.replace("{host}", host))
    assert client.get("/api/values", origin=origin).status == 403


def test_our_own_page_is_not_refused(client: Client) -> None:
    own = f"http://{client.host}:{client.port}"
    assert client.write("infeed", "feed", 1, origin=own, sec_fetch_site="same-origin").status == 200


def test_our_own_page_behind_a_proxy(client: Client) -> None:
    """The proxy has the certificate, and passes the name on."""
    own = {"host": "localhost", "origin": "https://localhost"}
    assert client.write("infeed", "feed", 1, **own).status == 200


def test_what_a_browser_says_of_another_site(client: Client) -> None:
    refused(client, 403, "other sites", sec_fetch_site="cross-site", sec_fetch_mode="no-cors")
    assert client.get("/api/values", sec_fetch_site="same-site").status == 403
    assert client.get("/", sec_fetch_site="cross-site", sec_fetch_mode="navigate").status == 200


@pytest.mark.parametrize(
    "host",
    [
        None,
        "",
        "evil.example",
        "evil.example:80",
        "127.0.0.1@evil.example",
        "127.0.0.1:x",
        "a b",
        "[",
    ],
)
def test_other_names_are_refused(client: Client, host: str | None) -> None:
    """A name of somebody else's that was made to point here (DNS rebinding)."""
    found = client.get("/api/values", host=host)
    assert found.status in (400, 421), found.body
    found = client.write("infeed", "feed", 99, host=host)
    assert found.status in (400, 421), found.body


@pytest.mark.parametrize("host", ["localhost:1", "127.0.0.1", "[::1]:8080"])
def test_own_names(client: Client, host: str) -> None:
    assert client.get("/api/values", host=host).status == 200


# -- requests that make no sense -----------------------------------------------------------------


@pytest.mark.parametrize(
    "body",
    [b"", b"{", b"[]", b"1", b'"x"', b"null", b"\xff\xfe", b"[" * 30000, b'{"device": 1}', b"{}"],
)
def test_bodies_that_are_none(client: Client, body: bytes) -> None:
    found = client.ask(
        "POST",
        "/api/write",
        body,
        content_type="application/json",
        authorization=f"Bearer {client.token}",
    )
    assert found.status == 400, found.body
    assert found.json["error"]["kind"] == "usage"


def test_a_body_that_is_too_long(client: Client) -> None:
    found = client.ask(
        "POST",
        "/api/write",
        b" " * 100_000,
        content_type="application/json",
        authorization=f"Bearer {client.token}",
    )
    assert found.status == 413


def test_what_there_is_not(client: Client) -> None:
    cases: list[tuple[str, int]] = [
        ("/api/values/infeed/nothing", 404),
        ("/api/values/nobody/speed", 404),
        ("/api/values?device=nobody", 404),
        ("/api/values?devise=infeed", 400),
        ("/api/lines/nothing/frames", 404),
        ("/api/history/infeed/nothing?start=0&end=1", 404),
        ("/api/history/infeed/speed?start=0", 400),
        ("/api/history/infeed/speed?start=1&end=1", 400),
        ("/api/history/infeed/speed?start=0&end=1&most=2001", 400),
        ("/api/history/infeed/speed?start=0&end=1&most=-1", 400),
        ("/api/history/infeed/speed?start=0&end=99999999999", 400),
        ("/api/history/infeed/speed?start=2026-11-22&end=2026-11-23T00:00:00", 400),
        ("/api/history/infeed/speed?start=%D9%A3&end=9", 400),
        ("/api/history/infeed/speed?start=0&end=nan", 400),
        ("/api/history.csv?start=0&end=1", 400),
        ("/api/history.csv?point=infeed&start=0&end=1", 404),
        ("/api/faults?device=nobody", 404),
        ("/api/faults/infeed/..%2f..%2ftokens", 404),
        ("/api/nothing", 404),
    ]
    for path, status in cases:
        found: Answer = client.get(path)
        assert (found.status, bool(found.reason)) == (status, True), path
    assert client.get("/api/write").status == 405
    assert client.ask("DELETE", "/api/plant", content_type="application/json").status == 405
    assert client.get("/api/faults").json == []


def test_no_http_at_all(client: Client) -> None:
    """What is no request, or never ends, harms nobody else."""
    for data in (b"\x00" * 100, b"GET / HTTP/9.9\r\n\r\n", b"GET /" + b"x" * 100_000):
        with socket.create_connection((client.host, client.port), PATIENCE) as connection:
            connection.sendall(data)
            try:
                said = connection.recv(100)
            except ConnectionError:
                said = b""
            assert not said or said.split()[1] in (b"400", b"421"), said
    assert client.get("/health").status == 200


# -- where it listens ----------------------------------------------------------------------------


def test_other_machines_need_token_and_tls(tmp_path: Path) -> None:
    file = tmp_path / "multidrop.toml"
    plant = (
        '[line.a]\nport = "tcp://127.0.0.1:1"\n[line.a.device.d]\nprofile = "flexmax"\naddress = 0\n'
        '[http]\nlisten = "{}"\n'
    )
    file.write_text(plant.format("0.0.0.0:0"), "utf-8")
    ran = multidrop("run", str(file))
    assert ran.status == 2
    assert "a token and a TLS certificate" in ran.err
    assert "multidrop token" in ran.err
    assert "openssl req" in ran.err
    checked = multidrop("check", str(file))
    assert (checked.status, "a token and a TLS certificate" in checked.err) == (2, True)
    file.write_text(plant.format("127.0.0.1"), "utf-8")
    assert "not HOST:PORT" in multidrop("check", str(file)).err


def test_a_port_that_is_taken(running_gateway: RunningGateway, tmp_path: Path) -> None:
    file = tmp_path / "multidrop.toml"
    there = f"127.0.0.1:{running_gateway.client.port}"
    file.write_text(
        '[line.a]\nport = "tcp://127.0.0.1:1"\n[line.a.device.d]\nprofile = "flexmax"\naddress = 0\n'
        f'points = {{ x = "8236:int16" }}\n[http]\nlisten = "{there}"\n',
        "utf-8",
    )
    ran = multidrop("run", str(file))
    assert ran.status == 5
    assert "another program listens there" in ran.err


# -- tokens --------------------------------------------------------------------------------------


def test_tokens_are_kept_as_hashes(tmp_path: Path) -> None:
    file = tmp_path / "tokens.toml"
    made = multidrop("token", "ann", "-o", str(file))
    assert made.status == 0
    assert made.out.startswith("mdt_")
    assert made.out.strip() not in file.read_text("utf-8")
    assert file.stat().st_mode & 0o077 == 0
    again = multidrop("token", "ann", "-o", str(file))
    assert (again.status, "already" in again.err) == (2, True)
    assert multidrop("token", "a b", "-o", str(file)).status == 2


def test_a_token_that_was_taken_back(running_gateway: RunningGateway) -> None:
    client, tokens = running_gateway.client, running_gateway.folder / "tokens.toml"
    gone = multidrop("token", "gone", "-o", str(tokens)).out.strip()
    assert client.get("/api/rights", authorization=f"Bearer {gone}").json["name"] == "gone"
    text = tokens.read_text("utf-8")
    tokens.write_text(text[: text.index("[gone]")], "utf-8")
    assert client.get("/api/rights", authorization=f"Bearer {gone}").status == 401
    assert client.get("/api/rights", authorization=f"Bearer {client.token}").status == 200


def test_other_machines_with_token_and_tls(tmp_path: Path) -> None:
    """As docs/howto/hardening.md says it; reading needs a token then, and plain HTTP is no answer."""
    made = "req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost"
    names = "-addext subjectAltName=DNS:localhost -keyout key.pem -out certificate.pem"
    command = [program("openssl"), *made.split(), *names.split()]
    subprocess.run(command, cwd=tmp_path, capture_output=True, check=True)
    plant = PLANT.replace("127.0.0.1:0", "0.0.0.0:0").replace(
        "tokens =", 'certificate = "certificate.pem"\nkey = "key.pem"\ntokens ='
    )
    with gateway(tmp_path, plant=plant) as started:
        port = started.client.port
        context = ssl.create_default_context(cafile=tmp_path / "certificate.pem")

        def ask(path: str, token: str | None) -> tuple[int, bytes]:
            connection = http.client.HTTPSConnection(
                "localhost", port, timeout=PATIENCE, context=context
            )
            headers = {} if token is None else {"Authorization": f"Bearer {token}"}
            with contextlib.closing(connection):
                connection.request("GET", path, headers=headers)
                found = connection.getresponse()
                return found.status, found.read()

        assert started.client.url.startswith("https://")
        assert ask("/health", None)[0] == 200
        assert ask("/", None)[0] == 200
        for path in ("/api/values", "/api/events", "/metrics", "/api/plant"):
            assert ask(path, None)[0] == 401
        assert ask("/api/plant", started.reader)[0] == 200
        with pytest.raises((OSError, http.client.HTTPException)):
            Client(f"http://127.0.0.1:{port}/").get("/health")
