"""Browsers that listen to a gateway's live values.

`python -m bench.browsers CPU HTTP-PORT COUNT` opens so many connections, prints `[]`
when all of them have heard all values once, and reads what comes until its standard input
ends. To a line there it answers with what the first of them was told since the last one:
device, point, value, and when the event was complete (monotonic, s), as one line of JSON.
"""

from __future__ import annotations

import json
import os
import select
import socket
import sys
from time import monotonic
from typing import Any

REQUEST = "GET /api/events HTTP/1.0\r\nHost: 127.0.0.1:{port}\r\nAccept: text/event-stream\r\n\r\n"
END = b"\n\n"


class Browsers:
    """Only what the first one hears is kept, and read when it is asked for."""

    def __init__(self, port: int, count: int) -> None:
        self._pieces: list[tuple[bytes, float]] = []
        self._rest = b""
        self._clients: dict[int, socket.socket] = {}
        self._poll = select.epoll()
        for _ in range(count):
            client = socket.create_connection(("127.0.0.1", port))
            client.sendall(REQUEST.format(port=port).encode())
            self._clients[client.fileno()] = client
            self._poll.register(client, select.EPOLLIN)
        self._first = next(iter(self._clients))

    def run(self) -> None:
        """Until the standard input ends."""
        heard: set[int] = set()
        self._poll.register(sys.stdin, select.EPOLLIN)
        while True:
            for fd, _ in self._poll.poll():
                if fd not in self._clients:
                    if not sys.stdin.readline():
                        return
                    print(json.dumps(self._told()), flush=True)
                    continue
                data = self._clients[fd].recv(1 << 16)
                if not data:
                    raise SystemExit("the gateway let a browser go")
                if fd == self._first:
                    self._pieces.append((data, monotonic()))
                if len(heard) < len(self._clients):
                    heard.add(fd)
                    if len(heard) == len(self._clients):
                        print("[]", flush=True)

    def _told(self) -> list[tuple[str, str, Any, float]]:
        found = []
        for data, at in self._pieces:
            *events, self._rest = (self._rest + data).split(END)
            for event in events:
                if event.startswith(b"event: values\n"):
                    values = json.loads(event.partition(b"data: ")[2])
                    found += [(v["device"], v["point"], v["value"], at) for v in values]
        self._pieces.clear()
        return found


if __name__ == "__main__":
    os.sched_setaffinity(0, {int(sys.argv[1])})
    Browsers(int(sys.argv[2]), int(sys.argv[3])).run()
