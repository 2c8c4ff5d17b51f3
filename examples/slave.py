"""One's own SLINK3 slave on the pure core, over TCP.

    python examples/slave.py                          a free port, and one master that reads it
    python examples/slave.py tcp://127.0.0.1:4005     serves there until Ctrl-C

The slave at address 5 measures a temperature (100, read-only) and has a limit
(101). `Slave` decides what the protocol decides (checksum, address, unknown
command, wrong length or type); what is left is a request to this program.
"""

from __future__ import annotations

import socket
import sys
import threading
from urllib.parse import urlsplit

import multidrop
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import Command, Format, Reply, Request, Response
from multidrop.protocols.slink3.messages import TypedParameter

TEMPERATURE, LIMIT = 100, 101
values = {TEMPERATURE: 215, LIMIT: 800}  # tenths of a degree


def respond(request: Request) -> Reply:
    """What this device says to a request that is not settled yet."""
    parameter = request.parameter
    if not isinstance(parameter, TypedParameter) or parameter.index not in values:
        return Reply(Response.PARAMETER_NOT_EXIST)
    if parameter.type_code not in (Format.VOID, Format.SHORT_INT):
        return Reply(Response.TYPE_VALUE_ERROR)
    if request.command == Command.READ_TYPED_PARAMETER:
        raw = values[parameter.index].to_bytes(2, "little", signed=True)
        return request.found(Format.SHORT_INT, raw)
    if parameter.index == TEMPERATURE:
        return Reply(Response.READ_ONLY_PARAMETER)
    values[parameter.index] = int.from_bytes(request.value, "little", signed=True)
    return Reply()


def serve(listener: socket.socket) -> None:
    """One master after the other."""
    while True:
        wire, _ = listener.accept()
        slave = slink3.Slave(5, slink3.AX_V)
        wire.settimeout(0.3)
        with wire:
            while True:
                try:
                    received = wire.recv(4096)
                except TimeoutError:  # silence: what is incomplete now stays incomplete
                    requests = slave.silence()
                else:
                    if not received:
                        break
                    requests = slave.receive_data(received)
                for request in requests:
                    wire.sendall(slave.answer(request, request.settled or respond(request)))


def main(listen: str | None) -> None:
    where = urlsplit(listen or "tcp://127.0.0.1:0")
    listener = socket.create_server((where.hostname or "127.0.0.1", where.port or 0))
    port = "tcp://{}:{}".format(*listener.getsockname())
    print(f"listening on {port}", flush=True)
    if listen:
        serve(listener)
    threading.Thread(target=serve, args=(listener,), daemon=True).start()
    with multidrop.connect(f"ax-v:5@{port}") as master:
        print("temperature", master.read("100:int16").value, "tenths of a degree")
        print(f"limit: {master.write('101:int16', 750).outcome}")
        try:
            master.read("102:int16")
        except multidrop.DeviceError as refusal:
            print(f"102: {refusal}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
