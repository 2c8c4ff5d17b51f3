"""Many paced lines of any protocol in one loop that never sleeps.

`python -m bench.many_simulated CPU COUNT BURST_MS PROFILE ...` serves COUNT lines
on TCP ports, each with one device at address 0; the profiles take turns, with
their own baud rate or another one (`ultra3000@9600`); `flexmax+8236` is one whose point
counts the line's answers. It prints its ports as a line of JSON, answers every line on
its standard input, `unanswered` with when the messages came that nobody answers, any
other with what it noted of each answer, line by line, and ends with its standard input.
"""

from __future__ import annotations

import gc
import heapq
import json
import os
import select
import socket
import sys
from collections import deque
from collections.abc import Sequence
from time import monotonic

from bench.counting import Count, let_count, numbers
from multidrop.catalog import load_profile
from multidrop.protocols import PROTOCOLS
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Connection, SimulatedLine

MOST_SENT = 8  # times, before the sockets are looked at again
MOST_HEARD = 2  # requests worked out meanwhile


class Line:
    """One line: a device that answers at once, and a wire on which every character takes its time.

    With a burst (s) the bytes of a time slot come together, without one each by
    itself: no byte leaves before it has passed on the wire.
    """

    def __init__(self, profile: str, burst: float) -> None:
        profile, _, counting = profile.partition("+")
        name, _, baud = profile.partition("@")
        settings = PROTOCOLS[load_profile(name).protocol].line
        settings = settings.with_options(baud=int(baud) if baud else None)
        simulated = simulated_device(name, 0)
        self._count = Count()
        self._show = let_count(simulated, numbers(counting), self._count) if counting else None
        device = SimulatedLine([simulated], settings.decoder)
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.client = self.listener  # until a master is connected
        self.noted: list[tuple[float, float, float]] = []
        """Of each answer: when its request came, its last byte was due, and was handed over."""
        self.unanswered: list[float] = []
        self.answers: deque[Answer] = deque()  # on the wire: the first one now
        self._device: Connection = device.attach()
        self._character = settings.character
        self._slot = burst or settings.character
        self._free_at = 0.0

    def accept(self) -> None:
        self.client, _ = self.listener.accept()
        self.client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def answer(self, data: bytes, came: float) -> Answer | None:
        """Take bytes that began to arrive at `came`; the answer that they call for is put on the wire."""
        start = max(came, self._free_at) + len(data) * self._character
        self._count.number = len(self.noted) + len(self.answers)
        if self._show is not None:
            self._show()
        self._device.receive(data, came)
        answer = self._device.send(came)
        self._free_at = start + len(answer) * self._character
        if not answer:
            self.unanswered.append(came)
            return None
        found = Answer(answer, came, start, self._free_at, start + self._slot)
        self.answers.append(found)
        return found

    def send(self, now: float) -> float:
        """Send what has passed of the first answer; returns when more is due."""
        try:
            return self._send(now)
        except OSError:  # the master has gone
            self.answers.clear()
            return 0.0

    def _send(self, now: float) -> float:
        answer = self.answers[0]
        if now >= answer.end:
            self.client.send(answer.data[answer.sent :])
            self.noted.append((answer.came, answer.end, now))
            self.answers.popleft()
            return self.answers[0].due if self.answers else 0.0
        slots = int((now - answer.start) / self._slot + 1e-6)  # whole ones; late ones go together
        passed = int(slots * self._slot / self._character + 1e-6)
        if passed > answer.sent:
            self.client.send(answer.data[answer.sent : passed])
            answer.sent = passed
        answer.due = min(answer.start + (slots + 1) * self._slot, answer.end)
        return answer.due


class Answer:
    """An answer on the wire from `start` to `end`; the next bytes of it are due at `due`."""

    __slots__ = ("came", "data", "due", "end", "sent", "start")

    def __init__(self, data: bytes, came: float, start: float, end: float, due: float) -> None:
        self.data, self.came, self.start, self.end = data, came, start, end
        self.due = min(due, end)
        self.sent = 0


class ManyLines:
    """Absolute times, one heap of what is due, and the sockets looked at in between."""

    def __init__(self, profiles: Sequence[str], count: int, burst: float) -> None:
        self.lines = [Line(profiles[at % len(profiles)], burst) for at in range(count)]
        self._poll = select.epoll()
        self._poll.register(sys.stdin, select.EPOLLIN)
        self._listening = {line.listener.fileno(): line for line in self.lines}
        self._connected: dict[int, Line] = {}
        self._heard: deque[tuple[Line, bytes, float]] = deque()
        self._due: list[tuple[float, int, Line]] = []  # at most one of each line
        for fd in self._listening:
            self._poll.register(fd, select.EPOLLIN)

    @property
    def ports(self) -> list[str]:
        return [f"tcp://127.0.0.1:{line.listener.getsockname()[1]}" for line in self.lines]

    def run(self) -> None:
        """Serve until the standard input ends.

        When a request came is noted at once; its answer is due 12 characters later,
        so that to work it out can wait until nothing else is due.
        """
        while True:
            for fd, _ in self._poll.poll(0):
                if fd in self._connected:
                    self._hear(fd)
                elif fd in self._listening:
                    self._accept(self._listening[fd])
                elif not (asked := sys.stdin.readline()):
                    return
                elif asked.strip() == "unanswered":
                    print(json.dumps([line.unanswered for line in self.lines]), flush=True)
                else:
                    print(json.dumps([line.noted for line in self.lines]), flush=True)
            if not self._send_due():
                for _ in range(min(MOST_HEARD, len(self._heard))):
                    self._answer(*self._heard.popleft())

    def _accept(self, line: Line) -> None:
        line.accept()
        self._connected[line.client.fileno()] = line
        self._poll.register(line.client, select.EPOLLIN)

    def _hear(self, fd: int) -> None:
        line = self._connected[fd]
        try:
            data = line.client.recv(4096)
        except ConnectionResetError:  # a master that ended with an answer on its way
            data = b""
        if data:
            self._heard.append((line, data, monotonic()))
        else:
            self._poll.unregister(fd)
            del self._connected[fd]  # the socket stays open, so that what is due can be sent

    def _answer(self, line: Line, data: bytes, came: float) -> None:
        answer = line.answer(data, came)
        if answer is not None and len(line.answers) == 1:
            heapq.heappush(self._due, (answer.due, id(line), line))

    def _send_due(self) -> bool:
        """Send what is due, most urgent first; whether there may be more."""
        due = self._due
        for _ in range(MOST_SENT):
            if not due or due[0][0] > (now := monotonic()):
                return False
            _, key, line = due[0]
            again = line.send(now)
            if again:
                heapq.heapreplace(due, (again, key, line))
            else:
                heapq.heappop(due)
        return True


if __name__ == "__main__":
    os.sched_setaffinity(0, {int(sys.argv[1])})
    served = ManyLines(sys.argv[4:], int(sys.argv[2]), float(sys.argv[3]) / 1000)
    print(json.dumps(served.ports), flush=True)
    gc.disable()  # there are no cycles, and looking for them takes milliseconds
    served.run()
