"""A plant of lines on which bytes take no time, in a process that sleeps when nothing is asked.

`python -m bench.unpaced_simulated CPU DEVICES KIND ...` serves a line on a TCP port for
each KIND, with so many devices of it, addresses from 0 on: `flexmax+9000-9009` is a FlexMax
in which these points count the line's answers. It prints its ports as a line of JSON. To
`count` it answers how many answers each line gave so far, to any other line when it handed
over each of them; it ends with its standard input.
"""

from __future__ import annotations

import gc
import json
import os
import select
import socket
import sys
from array import array
from collections.abc import Sequence
from time import monotonic

from bench.counting import Count, let_count, numbers
from multidrop.catalog import load_profile
from multidrop.protocols import PROTOCOLS
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Connection, SimulatedLine


class Line:
    """One line: devices that answer at once."""

    def __init__(self, kind: str, devices: int) -> None:
        profile, _, counting = kind.partition("+")
        settings = PROTOCOLS[load_profile(profile).protocol].line
        simulated = [simulated_device(profile, address) for address in range(devices)]
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.client = self.listener  # until a master is connected
        self.noted = array("d")
        """When each answer was handed over."""
        self._count = Count()
        shows = [let_count(device, numbers(counting), self._count) for device in simulated]
        self._shows = [show for show in shows if show is not None]
        self._line = SimulatedLine(simulated, settings.decoder)
        self._devices: Connection = self._line.attach()

    def accept(self) -> None:
        self.client, _ = self.listener.accept()
        self.client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._devices = self._line.attach()

    def hear(self) -> bool:
        """Take what came, and answer it; whether the master is still there."""
        try:
            data = self.client.recv(4096)
        except ConnectionResetError:  # a master that ended with an answer on its way
            data = b""
        if not data:
            return False
        self._count.number = len(self.noted)
        for show in self._shows:
            show()
        now = monotonic()
        self._devices.receive(data, now)
        answer = self._devices.send(now)
        if answer:
            self.noted.append(monotonic())
            self.client.send(answer)
        return True


def serve(lines: Sequence[Line]) -> None:
    """Until the standard input ends."""
    poll = select.epoll()
    poll.register(sys.stdin, select.EPOLLIN)
    listening = {line.listener.fileno(): line for line in lines}
    connected: dict[int, Line] = {}
    for fd in listening:
        poll.register(fd, select.EPOLLIN)
    while True:
        for fd, _ in poll.poll():
            if fd in connected:
                if not connected[fd].hear():
                    poll.unregister(fd)
                    connected.pop(fd).client.close()
            elif fd in listening:
                line = listening[fd]
                line.accept()
                connected[line.client.fileno()] = line
                poll.register(line.client, select.EPOLLIN)
            elif not (asked := sys.stdin.readline()):
                return
            elif asked.strip() == "count":
                print(json.dumps([len(line.noted) for line in lines]), flush=True)
            else:
                print(json.dumps([list(line.noted) for line in lines]), flush=True)


if __name__ == "__main__":
    os.sched_setaffinity(0, {int(sys.argv[1])})
    served = [Line(kind, int(sys.argv[2])) for kind in sys.argv[3:]]
    ports = [f"tcp://127.0.0.1:{line.listener.getsockname()[1]}" for line in served]
    print(json.dumps(ports), flush=True)
    gc.disable()  # there are no cycles, and looking for them takes milliseconds
    serve(served)
