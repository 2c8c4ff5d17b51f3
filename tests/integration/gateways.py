"""`multidrop run` on a simulated line, and a client that speaks plain HTTP to it."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from integration.processes import PATIENCE, Running, running
from integration.threads import simulated
from multidrop.gateway.web.tokens import Right, make_token

PLANT = """
[line.press]
port = "{port}"
[line.press.device.infeed]
profile = "flexmax"
address = 0
[line.press.device.infeed.points]
speed = {{ at = "actual_speed", every = 0.2, unit = "rpm" }}
feed = {{ at = "8236:int16", every = 0.3, unit = "m/min", scale = 0.1, role = "setting", meaning = "how fast it feeds", write = {{ min = 0, max = 150 }} }}
slow = {{ at = "8236:int16", write = {{ min = 0, max = 1000, rate = 60 }} }}
control = {{ at = "control_word", write = {{ min = 0, max = 65535 }}, motion = true }}
[line.press.device.press]
profile = "flexmax"
address = 1
[line.press.device.press.points]
speed = {{ at = "actual_speed", every = 0.5 }}
[http]
listen = "127.0.0.1:0"
tokens = "tokens.toml"
"""


@dataclass(frozen=True)
class Answer:
    """What an HTTP server said."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def reason(self) -> str:
        """Why it was refused."""
        return str(self.json["error"]["text"])


class Client:
    """Asks one server; a new connection each time, and no header that was not asked for."""

    def __init__(self, url: str, token: str | None = None) -> None:
        split = urlsplit(url)
        assert split.hostname is not None
        assert split.port is not None
        self.url = url
        self.host, self.port = split.hostname, split.port
        self.token = token

    def ask(
        self, method: str, path: str, body: bytes | None = None, /, **headers: str | None
    ) -> Answer:
        """Send a request; a header that is None is left out, `_` in its name is `-`.

        Head and body leave together: a server that refuses the head, and closes, would meet the
        body with a reset, which takes its answer along.
        """
        connection = http.client.HTTPConnection(self.host, self.port, timeout=PATIENCE)
        given = {name.replace("_", "-").lower(): value for name, value in headers.items()}
        known: dict[str, str | None] = {"host": f"{self.host}:{self.port}", **given}
        with contextlib.closing(connection):
            connection.connect()
            connection.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_CORK, 1)
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in known.items():
                if value is not None:
                    connection.putheader(name, value)
            if body is not None and "content-length" not in known:
                connection.putheader("content-length", str(len(body)))
            connection.endheaders(body)
            connection.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_CORK, 0)
            found = connection.getresponse()
            read = found.read()
            return Answer(found.status, {k.lower(): v for k, v in found.getheaders()}, read)

    def get(self, path: str, **headers: str | None) -> Answer:
        return self.ask("GET", path, **headers)

    def write(self, device: str, point: str, value: object, **headers: str | None) -> Answer:
        """As the page does it, with the token unless `authorization` says otherwise."""
        body = json.dumps({"device": device, "point": point, "value": value}).encode()
        headers.setdefault("content_type", "application/json")
        headers.setdefault("authorization", f"Bearer {self.token}")
        return self.ask("POST", "/api/write", body, **headers)

    @contextlib.contextmanager
    def stream(self, path: str, token: str | None = None) -> Iterator[Iterator[tuple[str, Any]]]:
        """The events of a stream: name, data."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=PATIENCE)
        with contextlib.closing(connection):
            known = {} if token is None else {"authorization": f"Bearer {token}"}
            connection.request("GET", path, headers=known)
            found = connection.getresponse()
            assert found.status == 200, found.read()
            assert found.getheader("content-type", "").startswith("text/event-stream")
            yield _events(found)


def _events(found: http.client.HTTPResponse) -> Iterator[tuple[str, Any]]:
    name = ""
    for line in found:
        text = line.decode().rstrip("\n")
        if text.startswith("event: "):
            name = text.removeprefix("event: ")
        elif text.startswith("data: "):
            yield name, json.loads(text.removeprefix("data: "))


@dataclass(frozen=True)
class RunningGateway:
    """A gateway in a process of its own."""

    client: Client
    program: Running
    folder: Path
    reader: str  # a token that may read only


def tokens(folder: Path) -> tuple[str, str]:
    """Of `tester`, who may write, and of `reader`, made as `multidrop token` makes them."""
    file = folder / "tokens.toml"
    writer = make_token(file, "tester", [Right.READ, Right.WRITE])
    return writer, make_token(file, "reader", [Right.READ])


@contextlib.contextmanager
def gateway(folder: Path, more: str = "", plant: str = PLANT) -> Iterator[RunningGateway]:
    """The plant above on a simulated line; `more` is added to its file."""
    with simulated("flexmax:0", "flexmax:1") as line:
        file = folder / "multidrop.toml"
        file.write_text(plant.format(port=line.port) + more, encoding="utf-8")
        writer, reader = tokens(folder)
        with running("run", str(file)) as program:
            url = program.wait_for("://")
            yield RunningGateway(Client(url, writer), program, folder, reader)
