"""Fuzzes Ultra3000: `python fuzz/fuzz_ultra3000.py -max_total_time=600`. README.md tells the rest."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import atheris
from harness import Provider, Target, fuzz

with atheris.instrument_imports(include=["multidrop"]):
    from multidrop.catalog import load_profile
    from multidrop.profile import Profile
    from multidrop.protocols import ultra3000
    from multidrop.protocols.ultra3000.broadcast import prepare_broadcast
    from multidrop.protocols.ultra3000.describe import describe, from_master
    from multidrop.protocols.ultra3000.device import device
    from multidrop.protocols.ultra3000.slave import Reply

VECTORS = Path(__file__).parent.parent / "tests" / "vectors" / "ultra3000.toml"

KEPT = ("drive_name", "firmware", "kp", "motor_gear_ratio", "preset_current", "drive_enable")
KEPT += ("setpoint_velocity", "reset_faults", "define_home", "fault_status", "run_status")
KEPT += ("analog_velocity_scale", "extended_fault_status")
"""One point of each kind: a slave with all of them takes long to make."""

WHOLE = load_profile("ultra3000")
FEW = replace(WHOLE, points={name: WHOLE.points[name] for name in KEPT})
NONE = Profile("ultra3000", "ultra3000")

PARAMETERS = [0x000, 0x002, 0x006, 0x011, 0x01A, 0x05C, 0x06F, 0x071, 0x073, 0x075, 0x118, 0x7F0]
WIDTHS = [0, 0, 2, 4, 6, 8, 10, 128]
POINTS = ["kp", "kp@nv", "kp@max", "preset_current.7", "drive_name", "run_status", "firmware"]
POINTS += ["analog_velocity_scale", "extended_fault_status", "0x7F0", "0x7F0.1@nv", "0x000"]
WRITES = [("kp", "1.5"), ("kp@nv", 2), ("setpoint_velocity", -1), ("preset_current.0", 0.5)]
WRITES += [("drive_name", "AXIS"), ("drive_enable", "1"), ("define_home", ""), ("0x7F0", "0x01")]
WRITES += [("0x7F0.3", 5), ("motor_gear_ratio.1", 0), ("kp", 99)]


def frame(data: Provider, sent: bytes) -> bytes:
    """A frame of any fields; where one was sent, often one that could answer it."""
    asked = ultra3000.decoder().receive_data(sent)
    if asked and data.ConsumeBool():
        address, parameter, function, told = asked[-1].frame
        if data.ConsumeIntInRange(0, 3) == 3:
            parameter, told = (parameter | 0x800), f"{data.ConsumeIntInRange(0, 9):02X}"
        elif data.ConsumeBool():
            told = digits(data, data.PickValueInList(WIDTHS))
        found = ultra3000.Frame(address, parameter, function, told)
    else:
        number = data.PickValueInList(PARAMETERS)
        found = ultra3000.Frame(
            data.PickValueInList([0, 1, 253, 255]),
            number if data.ConsumeBool() else data.ConsumeIntInRange(0, 0xFFF),
            data.ConsumeIntInRange(0, 15),
            digits(data, data.ConsumeIntInRange(0, 245)),
        )
    describe(found)
    from_master(found)
    return found.encode() + b"\n" * (data.ConsumeIntInRange(0, 7) == 7)


def digits(data: Provider, count: int) -> str:
    found: str = data.ConsumeBytes((count + 1) // 2).hex().upper().ljust(count, "0")
    return found[:count]


def slave(data: Provider) -> ultra3000.Slave:
    profile = FEW if data.ConsumeBool() else None
    return ultra3000.Slave(data.ConsumeIntInRange(0, 1), profile=profile)


def reply(data: Provider) -> Reply:
    refusal = data.PickValueInList([0, 0, 0, *ultra3000.Refusal, 0xFF])
    return Reply(refusal, digits(data, data.PickValueInList(WIDTHS)))


def conversation(data: Provider) -> Any:
    """Any service of a drive; what is refused is raised at the first step."""
    profile = data.PickValueInList([FEW, FEW, NONE])
    drive = device(data.ConsumeIntInRange(0, 1), profile, {})
    point, written = data.PickValueInList(POINTS), data.PickValueInList(WRITES)
    body = digits(data, data.ConsumeIntInRange(3, 16))

    def raw() -> Any:
        return (yield from drive.prepare_raw(body)())

    def broadcast() -> Any:
        return (yield from prepare_broadcast(profile, [written], [0, 1], {}, keep_going=True)())

    calls = [
        lambda: drive.read(drive.point(point)),
        lambda: drive.sample(drive.point(point)),
        lambda: drive.write(drive.prepare_write(*written, force=data.ConsumeBool())),
        lambda: drive.write(drive.prepare_write(*written), verify=False),
        lambda: drive.copy(drive.prepare_copy("kp", save=data.ConsumeBool())),
        lambda: drive.copy(drive.prepare_copy("preset_current", save=True), verify=False),
        lambda: drive.compare(drive.point(point)),
        drive.status,
        drive.clear_faults,
        drive.reset_comm,
        drive.prepare_action("reset_faults") if profile is FEW else drive.status,
        raw,
        lambda: drive.master.restore_default(0x05C, 3),
        broadcast,
    ]
    return (yield from data.PickValueInList(calls)())


def seeds() -> list[bytes]:
    vectors = tomllib.loads(VECTORS.read_text(encoding="utf-8"))["vector"]
    return [f"{vector['text']}\r".encode() for vector in vectors]


if __name__ == "__main__":
    fuzz(Target(ultra3000.LINE, frame, slave, reply, conversation, seeds(), skips=b"\n"))
