"""Fuzzes SLINK3: `python fuzz/fuzz_slink3.py -max_total_time=600`. README.md tells the rest."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import atheris
from harness import Provider, Target, fuzz

with atheris.instrument_imports(include=["multidrop"]):
    from multidrop.catalog import load_profile
    from multidrop.protocols import slink3
    from multidrop.protocols.slink3.broadcast import prepare_broadcast
    from multidrop.protocols.slink3.describe import describe
    from multidrop.protocols.slink3.device import device
    from multidrop.protocols.slink3.slave import Reply

VECTORS = Path(__file__).parent.parent / "tests" / "vectors" / "slink3.toml"

PROFILES = {name: load_profile(name) for name in ("slink3", "flexmax", "ax-v", "dgfc386")}
DIALECTS = [slink3.SLINK3, slink3.FLEXMAX, slink3.AX_V, slink3.DGFC386]
CODES = [*map(int, slink3.Command), *map(int, slink3.Response)]

POINTS = [
    "8236:int16",
    "8236",
    "8236.1:string",
    "511:uint8",
    "dgfc/511",
    "drive/8511:uint16",
    "std/0x6040.0:uint16",
    "std/0x6042.1:bytes",
]


def frame(data: Provider, sent: bytes) -> bytes:
    """A frame of any fields; where one was sent, often one that could answer it."""
    if sent and data.ConsumeBool():
        asked = slink3.Frame.decode(sent)
        body = asked.data if data.ConsumeBool() else asked.data[:3]
        found = slink3.Frame(
            asked.address,
            asked.control,
            asked.order & 0x0E | 1 | data.PickValueInList([0, 0x10]),
            0 if data.ConsumeBool() else data.PickValueInList(CODES),
            body + data.ConsumeBytes(data.ConsumeIntInRange(0, 4)),
        )
    else:
        found = slink3.Frame(
            data.PickValueInList([0, 1, 2, 128, 255]),
            data.ConsumeIntInRange(0, 255),
            data.ConsumeIntInRange(0, 255),
            data.PickValueInList(CODES)
            if data.ConsumeBool()
            else data.ConsumeIntInRange(0, 0xFFFF),
            data.ConsumeBytes(data.ConsumeIntInRange(0, 247)),
        )
    describe(found)
    return found.encode()


def slave(data: Provider) -> slink3.Slave:
    return slink3.Slave(
        data.ConsumeIntInRange(0, 2),
        data.PickValueInList(DIALECTS),
        option=data.ConsumeBool(),
        answer_damage=data.ConsumeBool(),
    )


def reply(data: Provider) -> Reply:
    return Reply(
        data.PickValueInList([0, 0, *CODES]), data.ConsumeBytes(data.ConsumeIntInRange(0, 12))
    )


def conversation(data: Provider) -> Any:
    """Any service of any device; what the device refuses is raised at the first step."""
    profile = PROFILES[data.PickValueInList(list(PROFILES))]
    drive = device(data.ConsumeIntInRange(0, 2), profile, {})
    point = data.PickValueInList(POINTS)

    def raw() -> Any:
        code = data.PickValueInList([0x24, 0x26] if data.ConsumeBool() else CODES)
        body = data.ConsumeBytes(data.ConsumeIntInRange(0, 5))
        return (yield from drive.prepare_raw((code.to_bytes(2, "little") + body).hex())())

    calls = [
        lambda: drive.read(drive.point(point)),
        lambda: drive.write(drive.prepare_write(point, 1)),
        lambda: drive.write(drive.prepare_write(point, "1"), verify=False),
        drive.status,
        drive.clear_faults,
        drive.reset_comm,
        drive.master.broadcast_verify,
        lambda: drive.master.special_access(data.ConsumeBytes(4)),
        raw,
        prepare_broadcast(profile, [("8236:int16", "7")], [0, 1], {}, keep_going=True),
    ]
    chosen = data.PickValueInList(calls)
    return (yield from chosen())


def seeds() -> list[bytes]:
    vectors = tomllib.loads(VECTORS.read_text(encoding="utf-8"))["vector"]
    return [bytes.fromhex(vector["bytes"]) for vector in vectors]


if __name__ == "__main__":
    fuzz(Target(slink3.LINE, frame, slave, reply, conversation, seeds()))
