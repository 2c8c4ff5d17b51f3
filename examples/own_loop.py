"""One's own driver loop on the pure core: bytes and time in, bytes out.

    python examples/own_loop.py [PORT]

PORT is a tcp:// address with an AX-V at address 2. `Exchange` does what a line
does (numbering, matching, gaps, time-outs, attempts) and knows no socket and no
clock, so it fits into any loop: a PLC runtime, a GUI, another event loop.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from typing import TypeVar
from urllib.parse import urlsplit

from multidrop import Error
from multidrop.conversation import Conversation
from multidrop.exchange import Exchange
from multidrop.protocols import slink3
from multidrop.session import Session

DEFAULT = os.environ.get("MULTIDROP_EXAMPLE_PORT", "tcp://127.0.0.1:4001")

ResultT = TypeVar("ResultT")


def run(
    wire: socket.socket,
    session: Session[slink3.Frame],
    conversation: Conversation[slink3.Frame, ResultT],
) -> ResultT:
    """Carry out one conversation. A session is what the line remembers between two of them."""
    exchange = Exchange(conversation, session)
    to_send = exchange.start(time.monotonic())
    while True:
        wire.sendall(to_send)
        if exchange.done:
            return exchange.result()  # or raises what the conversation raised
        wire.settimeout(max(0.001, exchange.deadline - time.monotonic()))
        try:
            received = wire.recv(4096)
        except TimeoutError:
            received = b""
        else:
            if not received:
                raise ConnectionError("the other side closed the connection")
        to_send = exchange.advance(received, time.monotonic())


def main(port: str) -> None:
    address = urlsplit(port)
    session = Session(slink3.decoder(), slink3.LINE.timing(network=True))
    drive = slink3.Master(2, slink3.AX_V)
    with socket.create_connection((address.hostname or "", address.port or 0)) as wire:
        found = run(wire, session, drive.read_typed(1009))
        print("IPA 1009 =", found.value, "bytes", found.raw.hex(" ").upper())
        try:
            run(wire, session, drive.read_typed(9999))
        except Error as error:
            print(f"IPA 9999: {error}")
    print(session.counters)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else DEFAULT)
