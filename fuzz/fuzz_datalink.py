"""Fuzzes Datalink, stuffed and not: `python fuzz/fuzz_datalink.py -max_total_time=600`."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import atheris
from harness import Provider, Target, fuzz

with atheris.instrument_imports(include=["multidrop"]):
    from multidrop.catalog import load_profile
    from multidrop.protocols import datalink
    from multidrop.protocols.datalink.describe import describe
    from multidrop.protocols.datalink.device import device
    from multidrop.protocols.datalink.slave import Reply

VECTORS = Path(__file__).parent.parent / "tests" / "vectors" / "datalink.toml"

PROFILES = {name: load_profile(name) for name in ("datalink", "53ml5100", "53sl6000")}
WITH_DATA = [
    datalink.Command.RESPONSE,
    datalink.Command.CHANGE,
    datalink.Command.CHANGE_BITS,
]
PLACES = [0x0600, 0x1000, 0x8002, 0x7E7E, 0x007E, 0xFFE0, 0xFFFF]

POINTS = ["C103", "L14", "B1", "H0", "A0", "F3", "mem/0x1000/9", "mem/0x7E7E/32", "mem/0xFFFF/1"]
WRITES = [
    ("C103", 1111.0),
    ("L14", True),
    ("B1", 0x7E),
    ("H0", "1e9"),
    ("A0", "TAG"),
    ("mem/0x1000/2", b"\x7e\x00"),
    ("mem/0x7E7E/32", b"\x7e" * 32),
    ("mem/0xFFFF/1", b"\x00"),
]


def frame(data: Provider, sent: bytes) -> bytes:
    """A frame of any fields; where one was sent, often one that could answer it."""
    asked = datalink.decoder().receive_data(sent)
    if asked and data.ConsumeBool():
        question = asked[-1].frame
        size = question.count if data.ConsumeBool() else data.ConsumeIntInRange(0, 32)
        body = question.data or filled(data, size)
        if data.ConsumeBool():
            body = filled(data, len(body))
        found = datalink.Frame(
            datalink.Command.RESPONSE, question.address, question.memory_address, len(body), body
        )
    else:
        found = any_frame(data)
    describe(found)
    return found.encode(stuffing=data.ConsumeIntInRange(0, 7) < 7)


def any_frame(data: Provider) -> datalink.Frame:
    command = data.PickValueInList(list(datalink.Command))
    address = data.PickValueInList([0, 3, 30, 31])
    if command is datalink.Command.ACKNOWLEDGE:
        return datalink.Frame(command, address)
    at = data.PickValueInList(PLACES) if data.ConsumeBool() else data.ConsumeIntInRange(0, 0xFFFF)
    size = data.ConsumeIntInRange(0, 32)
    body = filled(data, size) if command in WITH_DATA else b""
    return datalink.Frame(command, address, at, size, body)


def filled(data: Provider, size: int) -> bytes:
    """So many bytes; those that stuffing is about more often than chance has them."""
    found = bytes(data.ConsumeBytes(size)).ljust(size, b"\x7e")
    return found.replace(b"\x01", b"\x7e").replace(b"\x02", b"\x7e\x00"[: data.ConsumeBool() + 1])[
        :size
    ]


def stuffed_slave(data: Provider) -> datalink.Slave:
    return datalink.Slave(data.PickValueInList([0, 3, 30, 31]))


def unstuffed_slave(data: Provider) -> datalink.Slave:
    return datalink.Slave(data.PickValueInList([0, 3, 30, 31]), stuffing=False)


def reply(data: Provider) -> Reply:
    return Reply(b"\x06" if data.ConsumeBool() else filled(data, data.ConsumeIntInRange(0, 32)))


def conversation(data: Provider, stuffing: str) -> Any:
    """Any service of any instrument; what it refuses is raised at the first step."""
    profile = PROFILES[data.PickValueInList(list(PROFILES))]
    options = {"stuffing": stuffing, "settle": data.PickValueInList(["0", "0.2", "1"])}
    instrument = device(data.PickValueInList([0, 3, 31]), profile, options)
    point, written = data.PickValueInList(POINTS), data.PickValueInList(WRITES)

    def group() -> Any:
        chosen = [instrument.point(text) for text in POINTS[: data.ConsumeIntInRange(1, 9)]]
        for points in instrument.plan(chosen):
            yield from instrument.read_group(points)

    def raw() -> Any:
        body = any_frame(data).encode(stuffing=False)[1:-1]
        return (yield from instrument.prepare_raw(body.hex())())

    calls = [
        lambda: instrument.read(instrument.point(point)),
        group,
        lambda: instrument.write(instrument.prepare_write(*written)),
        lambda: instrument.write(instrument.prepare_write(*written), verify=False),
        lambda: instrument.master.change_and_confirm(0x1000, filled(data, 9), settle=0.2),
        lambda: instrument.master.change_bits(0x500, [(data.ConsumeIntInRange(0, 255), 0x55)]),
        lambda: instrument.master.interrogate(0x7E00, data.ConsumeIntInRange(0, 100)),
        instrument.status,
        instrument.clear_faults,
        instrument.reset_comm,
        raw,
    ]
    return (yield from data.PickValueInList(calls)())


def stuffed_conversation(data: Provider) -> Any:
    return (yield from conversation(data, "on"))


def unstuffed_conversation(data: Provider) -> Any:
    return (yield from conversation(data, "off"))


def seeds(key: str) -> list[bytes]:
    vectors = tomllib.loads(VECTORS.read_text(encoding="utf-8"))["vector"]
    return [bytes.fromhex(vector[key]) for vector in vectors if key in vector]


if __name__ == "__main__":
    fuzz(
        Target(datalink.LINE, frame, stuffed_slave, reply, stuffed_conversation, seeds("bytes")),
        Target(
            datalink.LINE_WITHOUT_STUFFING,
            frame,
            unstuffed_slave,
            reply,
            unstuffed_conversation,
            seeds("unstuffed"),
        ),
    )
