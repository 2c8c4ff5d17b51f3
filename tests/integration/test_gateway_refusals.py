"""What must not be written, from foreign clients and bare sockets: refused with its reason, and no write on the wire.

The drive itself is the witness: it counts what was written to it, whatever the gateway says.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import itertools
import json
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial
from pathlib import Path

import pytest
from programs import program

from integration.mosquitto import Broker, broker, found
from integration.processes import PATIENCE, multidrop
from integration.published import Published, published, ran
from integration.servers import Connected, Server, serving
from integration.test_gateway_mqtt import watcher
from integration.writes import logged
from multidrop.gateway.modbus.part import ModbusServer
from multidrop.gateway.mqtt import broker as mqtt_broker
from multidrop.gateway.mqtt import part as mqtt
from multidrop.points import Value
from multidrop.sim.slink3 import FlexMax

TABLES = """
[http]
listen = "127.0.0.1:0"
tokens = "tokens.toml"
[modbus]
listen = "127.0.0.1:0"
writes = true
[mqtt]
host = "127.0.0.1"
port = {port}
commands = true
"""


class Witness:
    """Everything that was written to a drive."""

    def __init__(self, site: Published, token: str) -> None:
        self.site = site
        self.token = token
        self.written: list[Value] = []
        drive = site.line.devices[0]
        assert isinstance(drive, FlexMax)
        for parameter in drive.parameters.known.values():
            before = parameter.set

            def note(value: Value, now: float, before: object = before) -> None:
                self.written.append(value)
                if callable(before):
                    before(value, now)

            parameter.set = note

    @property
    def modbus(self) -> str:
        server = self.site.gateway.parts["modbus"]
        assert isinstance(server, ModbusServer)
        return server.port.rpartition(":")[2]

    @property
    def http(self) -> int:
        url = next(text for text in self.site.said if text.startswith("http://"))
        return int(url.rstrip("/").rpartition(":")[2])

    async def bare(self, request: bytes, *, gone: bool = False) -> str:
        """What the HTTP server says to these bytes; `gone`: the connection is closed behind them."""

        def ask() -> bytes:
            with socket.create_connection(("127.0.0.1", self.http), PATIENCE) as connection:
                connection.sendall(request)
                if gone:
                    connection.shutdown(socket.SHUT_WR)
                said = b""
                with contextlib.suppress(ConnectionError):
                    while data := connection.recv(65536):
                        said += data
                return said

        return (await asyncio.to_thread(ask)).decode()


@contextlib.asynccontextmanager
async def watched(folder: Path, mosquitto: Broker) -> AsyncIterator[Witness]:
    made = await asyncio.to_thread(
        multidrop, "token", "ann", "--write", "-o", str(folder / "tokens.toml")
    )
    async with published(folder, TABLES.replace("{port}", str(mosquitto.port))) as site:
        await site.until(lambda: any("http://" in text for text in site.said))
        async with watcher(mosquitto) as watching:  # online: it has subscribed to commands
            await watching.until("multidrop/status", lambda status: status == "online")
        await site.until_value("infeed", "torque", 0)
        yield Witness(site, made.out.strip())


def run(folder: Path, test: Callable[[Witness, Broker], Awaitable[None]]) -> None:
    async def main(mosquitto: Broker) -> None:
        async with watched(folder, mosquitto) as witness:
            await test(witness, mosquitto)

    with broker(folder) as mosquitto:
        asyncio.run(main(mosquitto))


ARABIC = "\N{ARABIC-INDIC DIGIT FIVE}"


def has_lines(audit: Path, number: int) -> bool:
    return len(logged(audit)) >= number


EXPIRY = ("-D", "PUBLISH", "message-expiry-interval", "5")
SET = "multidrop/infeed/torque/set"


def test_mosquitto_pub(tmp_path: Path, audit: Path) -> None:
    """Each is in the log with its reason, in the order in which they came; the last one is right."""
    cases: list[tuple[str, tuple[str, ...], str]] = [
        (SET, ("-m", "5"), "it has no message expiry"),
        (SET, ("-m", "5", "-D", "PUBLISH", "message-expiry-interval", "3600"), "expiry is 3600 s"),
        (SET, ("-m", "5", "-r", *EXPIRY), "a retained message"),
        (SET, ("-n", *EXPIRY), "'' is not a number"),
        (SET, ("-m", "fast", *EXPIRY), "'fast' is not a number"),
        (SET, ("-m", '{"value": 5}', *EXPIRY), "is not a number"),
        (SET, ("-m", "0x10", *EXPIRY), "'0x10' is not a number"),
        (SET, ("-m", "5,5", *EXPIRY), "'5,5' is not a number"),
        (SET, ("-m", ARABIC, *EXPIRY), f"'{ARABIC}' is not a number"),
        (SET, ("-m", "-Infinity", *EXPIRY), "is not a number"),
        (SET, ("-m", "1500.5", *EXPIRY), "is out of range"),
        (SET, ("-m", "0.5", *EXPIRY), "0.5"),
        (SET, ("-f", "bytes", *EXPIRY), "is not a number"),
        ("multidrop/infeed/speed/set", ("-m", "5", *EXPIRY), "may not be written"),
        ("multidrop/INFEED/torque/set", ("-m", "5", *EXPIRY), "is the topic of no point"),
        ("multidrop//torque/set", ("-m", "5", *EXPIRY), "is the topic of no point"),
        ("multidrop/infeed/torque%00/set", ("-m", "5", *EXPIRY), "is the topic of no point"),
        ("multidrop/infeed/control_word/set", ("-m", "15", *EXPIRY), "is the topic of no point"),
    ]
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00\x05")

    async def check(witness: Witness, mosquitto: Broker) -> None:
        program = found("mosquitto_pub")
        for number, (topic, how, reason) in enumerate(cases, 1):
            arguments = [str(tmp_path / "bytes") if one == "bytes" else one for one in how]
            port = str(mosquitto.port)
            status, out = await ran(
                program, "-V", "5", "-q", "1", "-p", port, "-t", topic, *arguments
            )
            assert status == 0, out
            await witness.site.until(partial(has_lines, audit, number))
            line = logged(audit)[-1]
            said = line["error"] or ""
            assert (line["outcome"], reason in said) == ("not-sent", True), (topic, how, said)
        for topic in ("multidrop/infeed/set", "multidrop/a/b/c/set", "multidrop/infeed/torque"):
            await ran(program, "-V", "5", "-p", port, "-t", topic, "-m", "5", *EXPIRY)
        assert witness.written == []
        await ran(program, "-V", "5", "-p", port, "-t", SET, "-m", "321", *EXPIRY)
        await witness.site.until_value("infeed", "torque", 321)
        assert witness.written == [321]
        assert len(logged(audit)) == len(cases) + 1

    run(tmp_path, check)


def test_mbpoll(tmp_path: Path, audit: Path) -> None:
    async def check(witness: Witness, mosquitto: Broker) -> None:
        for place, kind, values, said in (
            ("0", "4", ("1501",), "Illegal data value"),
            ("1", "4", ("5",), "Illegal data address"),  # a point that only measures
            ("0", "4", ("5", "5"), "Illegal data address"),  # two points at once
            ("100", "4", ("5",), "Illegal data address"),  # half a float
            ("50", "4", ("5",), "Illegal data address"),
            ("65535", "4", ("5",), "Illegal data address"),
            ("0", "0", ("1",), "Illegal function"),  # a coil
        ):
            status, out = await ran(
                program("mbpoll", "make mbpoll"),
                "-0",
                "-1",
                "-p",
                witness.modbus,
                "-t",
                kind,
                "-r",
                place,
                "127.0.0.1",
                *values,
            )
            assert (status != 0, said in out) == (True, True), out
        assert witness.written == []
        assert {line["outcome"] for line in logged(audit)} == {"not-sent"}

    run(tmp_path, check)


BODY = b'{"device": "infeed", "point": "torque", "value": 99}'


def request(token: str, *more: str, body: bytes = BODY, length: int | None = None) -> bytes:
    size = len(body) if length is None else length
    head = [
        "POST /api/write HTTP/1.1",
        "Host: 127.0.0.1",
        "Connection: close",
        "Content-Type: application/json",
        f"Authorization: Bearer {token}",
        f"Content-Length: {size}",
        *more,
    ]
    return "\r\n".join([*head, "", ""]).encode() + body


BARE: list[tuple[Callable[[str], bytes], str | None]] = [
    (lambda t: request(t, "Host: evil.example"), "400"),
    (lambda t: request(t, "Content-Length: 7"), "400"),
    (lambda t: request(t, "Transfer-Encoding: chunked"), "400"),
    (lambda t: request(t, "Transfer-Encoding: chunked", body=b"0\r\n\r\n" + BODY), "400"),
    (lambda t: request("x", f"Authorization: Bearer {t}"), "400"),
    (lambda t: request(t, "Authorization: Bearer x"), "400"),
    (lambda t: request(t, "Content-Type: text/plain"), "400"),
    (lambda t: request(t, "Origin: http://evil.example", "Origin: http://127.0.0.1"), "400"),
    (lambda t: request(t, "Origin: http://127.0.0.1", "Origin: http://evil.example"), "400"),
    (lambda t: request(t).replace(b"\r\nHost: 127.0.0.1", b""), "400"),
    (lambda t: request(t).replace(b"POST", b"PUT"), "405"),
    (lambda t: request(t).replace(b"/api/write", b"/api/write/"), "307"),
    (lambda t: request(t).replace(b"/api/write", b"//api/write"), "405"),
    (lambda t: request(t).replace(b"/api/write", b"/api/write?value=5"), "400"),
    (lambda t: request(t).replace(b"Bearer mdt_", b"Bearer \xffmdt_"), "401"),
    (lambda t: request(t, length=len(BODY) + 1), None),  # it ends before its end
    (lambda t: request(t, body=BODY.replace(b"}", b', "value": 5}')), "400"),
    (lambda t: request(t, body=BODY.replace(b"}", b', "point": "speed"}')), "400"),
    (lambda t: request(t, body=BODY.replace(b"}", b', "force": true}')), "400"),
    (lambda t: request(t, body=BODY.replace(b"99", b"99 ]")), "400"),
    (lambda t: request(t, body=BODY.replace(b"99", b"1e400")), "400"),
    (lambda t: request(t, body=BODY.replace(b"99", b"9" * 5000)), "400"),
    (lambda t: request(t, body=BODY.replace(b"infeed", b"infeed\\u0000")), "404"),
    (lambda t: request(t, body=BODY.replace(b"infeed", b"\\ud800")), "404"),
    (lambda t: request(t, body=b"\xef\xbb\xbf" + BODY), "400"),
]


def test_bare_requests(tmp_path: Path) -> None:
    """One thing is wrong with each; without it the write is made."""

    async def check(witness: Witness, mosquitto: Broker) -> None:
        for make, status in BARE:
            asked = make(witness.token)
            said = await witness.bare(asked, gone=status is None)
            if status is None:
                assert said == "" or said.split()[1] == "400", (asked, said)
            else:
                assert said.split()[1:2] == [status], (asked, said)
                _, _, body = said.partition("\r\n\r\n")
                assert not body.startswith("{") or json.loads(body)["error"]["text"]
            assert witness.written == [], asked
        assert (await witness.bare(request(witness.token))).split()[1] == "200"
        assert witness.written == [99]

    run(tmp_path, check)


@pytest.mark.filterwarnings("ignore:unclosed <socket.socket:ResourceWarning")
def test_what_calls_itself_a_broker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is away, whatever it says, and everything else goes on."""
    monkeypatch.setattr(mqtt, "FIRST_PAUSE", 0.05)
    monkeypatch.setattr(mqtt, "LONGEST_PAUSE", 0.05)
    monkeypatch.setattr(mqtt_broker, "TIMEOUT", 0.2)
    garbage = [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\x00" * 100, b"\x20\xff\xff\xff\xff\x7f"]
    garbage += [
        b"\x20\x03\x00\x87\x00",
        b"\x20\x03\x00\x00\x00\x30\xff\xff\xff\x7f",
        b"\x20\x02\x00",
    ]

    said = itertools.cycle(garbage)

    def answer(caller: Connected) -> None:
        caller.connection.recv(1000)
        caller.send(next(said))
        caller.pause(0.05)

    async def main(server: Server) -> None:
        port = server.port.rpartition(":")[2]
        async with published(tmp_path, f'[mqtt]\nhost = "127.0.0.1"\nport = {port}\n') as site:
            await site.until(lambda: server.connections > len(garbage))
            await site.until_value("infeed", "torque", 0)
            assert any("is away" in text for text in site.said)

    with serving(answer) as server:
        asyncio.run(main(server))
    gc.collect()  # the client library leaves it to this to close a socket that got no answer
