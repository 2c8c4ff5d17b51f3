"""Backup, diff and restore of simulated devices of every protocol, through real sockets."""

from __future__ import annotations

import contextlib
import json
import os
import random
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from integration.presses import press
from integration.processes import COMMAND, PATIENCE, environment, multidrop
from integration.threads import served
from multidrop import errors
from multidrop.catalog import load_profile
from multidrop.io.connection import Connection, Target, connect
from multidrop.naming import parse_device
from multidrop.passports.backup import Backup, backup, load, save
from multidrop.passports.difference import differences
from multidrop.passports.passport import Entry, Passport
from multidrop.passports.restore import Action, Verdict, carry_out, plan
from multidrop.points import Point, Role, Value
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault, NoFaults, RandomFaults
from multidrop.sim.line import LineFaults, SimulatedLine

PRESS = press(
    'actual_speed = { at = "std/0x6044.0:int16", role = "measured", access = "r" }',
    'speed_setpoint = { at = "std/0x6042.0:int16", role = "setpoint", unit = "rpm" }',
    *(
        f'ramp_{n} = {{ at = "{9000 + n}:{kind}", role = "setting", unit = "s", scale = {scale}, minimum = 0, maximum = 100 }}'
        for n, (kind, scale) in enumerate(
            [("int16", 0.1), ("uint16", 0.01), ("int16", 1), ("int32", 0.001), ("uint32", 1), ("float32", 1)] * 3
        )
    ),
)  # fmt: skip

KILLS, RATES = (10, [0.0, 0.05]) if os.environ.get("MULTIDROP_SOAK") else (4, [0.05])
FAULTS = (Fault.NO_ANSWER, Fault.LATE_ANSWER, Fault.WRONG_CHECKSUM, Fault.CUT_SHORT, Fault.NOISE, Fault.OTHER_SLAVE)  # fmt: skip


@dataclass
class Bench:
    """A device of one protocol on a line of its own: how it is named, and its line."""

    name: str
    profile: str
    line: SimulatedLine

    @property
    def options(self) -> list[str]:
        return ["--profile", self.profile] if self.profile.endswith(".toml") else []

    def connect(self) -> Connection:
        return connect(Target(parse_device(self.name), load_profile(self.profile)))

    def run(self, *arguments: str, status: int = 0) -> str:
        done = multidrop(*arguments, *self.options)
        assert done.status == status, done.err + done.out
        return done.out


@contextlib.contextmanager
def on_a_line(profile: str, address: int) -> Iterator[Bench]:
    """A simulated device behind a TCP port."""
    described = load_profile(profile)
    settings = Target(parse_device(f"{described.name}:{address}@x"), described).settings
    line = SimulatedLine(
        [simulated_device(described, address)], settings.decoder, character=settings.character
    )
    with served(line) as place:
        yield Bench(place.device(f"{described.name}:{address}", timeout=0.2), profile, line)


@pytest.fixture(params=["slink3", "datalink", "ultra3000"])
def profile(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A profile of each protocol: FlexMax' own has no settings, so a press has some."""
    press = tmp_path / "press.toml"
    press.write_text(PRESS)
    return {"slink3": str(press), "datalink": "53mc5000", "ultra3000": "ultra3000"}[request.param]


@pytest.fixture
def bench(profile: str) -> Iterator[Bench]:
    with on_a_line(profile, 3) as made:
        yield made


def settings_of(
    connection: Connection, count: int, seed: int, among: Passport | None = None
) -> list[Point]:
    """Some settings that can be written, drawn from all of the profile or those of a passport."""
    made = [
        connection.device.point(entry.point)
        for entry in (among or backup(connection)).points.values()
        if entry.role is Role.SETTING and entry.type not in ("string", "bytes")
    ]
    writable = [point for point in made if point.description and "w" in point.description.access]
    return random.Random(seed).sample(writable, count)


def change(connection: Connection, points: list[Point]) -> None:
    """Give each another value, within its limits."""
    for point in points:
        assert point.description is not None
        old = connection.read(point).value
        low, high = point.description.minimum, point.description.maximum
        for value in (low, high, 0, 1, 2, 3):
            if value is not None and _another(value, old):
                with contextlib.suppress(errors.UsageError, errors.DeviceError):
                    connection.write(point.text, value)
                    break
        else:
            raise AssertionError(f"{point} takes no other value than {old!r}")


def _another(value: float, old: Value) -> bool:
    return bool(value != old)


def test_a_drive_gets_back_the_ten_settings_that_were_changed(bench: Bench, tmp_path: Path) -> None:
    passport = str(tmp_path / "a.passport.toml")
    bench.run("backup", bench.name, "-o", passport)
    assert bench.run("diff", passport, bench.name) == ""
    with bench.connect() as device:
        changed = settings_of(device, 10, seed=1)
        change(device, changed)
    differing = bench.run("diff", passport, bench.name, "--json", status=1)
    assert {line["point"] for line in map(json.loads, differing.splitlines())} == {
        point.text for point in changed
    }
    planned = bench.run("restore", passport, bench.name, "--dry-run")
    assert "10 to write" in planned
    assert bench.run("diff", passport, bench.name, status=1).count("\n") == 10, "a dry run wrote"
    done = bench.run("restore", passport, bench.name, "--yes", "--while-enabled")
    assert "10 restored" in done
    assert bench.run("diff", passport, bench.name) == ""
    (undo,) = tmp_path.glob("a.passport.undo-*.toml")
    again = bench.run("restore", str(undo), bench.name, "--yes", "--while-enabled")
    assert "10 restored" in again
    after = bench.run("diff", passport, bench.name, "--json", status=1)
    assert after.replace("after", "") == differing.replace("after", "")


def test_the_same_on_a_line_with_faults(bench: Bench, tmp_path: Path) -> None:
    """5 % of the answers come damaged, or not at all; a restore that did not end well is run again."""
    rates = dict.fromkeys(FAULTS, 0.05 / len(FAULTS))
    with bench.connect() as device:
        before = some_of(backup(device))
        change(device, settings_of(device, 10, seed=2, among=before))
        bench.line.faults = LineFaults(RandomFaults(rates, seed=7), late=0.05)
    with bench.connect() as device:
        points = [device.device.point(point) for point in before.points]
        run = Backup(device, points)
        assert len(list(run.run())) == len(points)
        assert not run.failed
        assert len(list(differences(before, run.passport()))) == 10
        for _ in range(5):
            planned = plan(device, before)
            verdicts = [done.verdict for done in carry_out(device, planned)]
            if set(verdicts) <= {Verdict.RESTORED, Verdict.SAME, Verdict.SKIPPED}:
                break
        bench.line.faults = LineFaults(NoFaults())
    with bench.connect() as device:
        assert list(differences(before, some_of(backup(device)))) == []


def some_of(passport: Passport) -> Passport:
    """A passport of fewer points: a given-up question about an array makes the next one rest 1.5 s."""
    kept = [point for point in passport.points if "." not in point][:120]
    return replace(passport, points={point: passport.points[point] for point in kept})


@pytest.mark.parametrize("rate", RATES)
def test_a_restore_that_was_killed_is_run_again_and_finishes_the_rest(
    bench: Bench, tmp_path: Path, rate: float
) -> None:
    """Wherever it was killed, a setting is as it was or as it shall be; what is left is done then."""
    passport = tmp_path / "a.toml"
    with bench.connect() as device:
        before = some_of(backup(device))
        save(before, passport)
        changed = settings_of(device, 10, seed=3, among=before)
        change(device, changed)
        wrong = held(device, changed)
    with heard(bench.line) as planning:
        bench.run("restore", str(passport), bench.name, "--dry-run")
    with heard(bench.line) as whole:
        restore(bench, passport).wait(3 * PATIENCE)
    faults = RandomFaults(dict.fromkeys(FAULTS, rate / len(FAULTS)), seed=5)
    moments = random.Random(4)
    halves = 0
    done = {point.text for point in changed}
    for _ in range(KILLS):
        with bench.connect() as device:
            if len(done) == len(changed):
                change(device, changed)
            bench.line.faults = LineFaults(faults, late=0.05)
            moment = moments.randrange(planning.pieces - 10, whole.pieces)
            with heard(bench.line, moment) as passed:
                passed.process = restore(bench, passport)
                passed.process.wait(3 * PATIENCE)
            bench.line.faults = LineFaults(NoFaults())
            now = held(device, changed)
        done = {text for text, raw in now.items() if raw == before.points[text].raw}
        assert all(now[text] == wrong[text] for text in now if text not in done)
        halves += 0 < len(done) < len(changed)
    assert halves, "none was killed between two writes"
    bench.run("restore", str(passport), bench.name, "--yes", "--while-enabled")
    with bench.connect() as device:
        assert list(differences(before, some_of(backup(device)))) == []
    for undo in tmp_path.glob("a.undo-*"):
        load(undo)  # whole, or not there under its name


@dataclass
class Heard:
    """What passed on a line, counted; at a moment of it a process is killed."""

    moment: int = 0
    pieces: int = 0
    process: subprocess.Popen[bytes] | None = None

    def __call__(self, data: bytes, passed_at: float) -> None:
        self.pieces += 1
        if self.pieces == self.moment and self.process is not None:
            self.process.kill()


@contextlib.contextmanager
def heard(line: SimulatedLine, moment: int = 0) -> Iterator[Heard]:
    ear = Heard(moment)
    line.ears.append(ear)
    try:
        yield ear
    finally:
        line.ears.remove(ear)


def restore(bench: Bench, passport: Path) -> subprocess.Popen[bytes]:
    """A restore in a process of its own."""
    return subprocess.Popen(
        [COMMAND, "restore", str(passport), bench.name, "--yes", "--while-enabled", *bench.options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=environment(),
    )


def held(device: Connection, points: list[Point]) -> dict[str, str]:
    return {point.text: device.read(point).raw_text for point in points}


def test_another_address_takes_the_passport_and_keeps_its_address(
    profile: str, tmp_path: Path
) -> None:
    passport = tmp_path / "a.toml"
    with on_a_line(profile, 3) as one, one.connect() as device:
        change(device, settings_of(device, 10, seed=5))
        save(backup(device), passport)
    with on_a_line(profile, 4) as spare:
        spare.run("restore", str(passport), spare.name, "--yes", "--while-enabled")
        with spare.connect() as device:
            left = list(differences(load(passport), backup(device)))
            roles = {difference.before.role for difference in left if difference.before}
            assert roles <= {Role.COMMUNICATION, Role.IDENTITY}


def test_a_device_that_runs_is_left_alone(bench: Bench, tmp_path: Path) -> None:
    passport = tmp_path / "a.toml"
    with bench.connect() as device:
        save(backup(device), passport)
        change(device, settings_of(device, 3, seed=6))
        enable(device)
        held = {point: entry.raw for point, entry in backup(device).points.items()}
    refused = multidrop("restore", str(passport), bench.name, "--yes", *bench.options)
    assert refused.status == 2
    assert "says that it is running" in refused.err
    bench.run("restore", str(passport), bench.name, "--dry-run")
    with bench.connect() as device:
        now = backup(device)
        settings = [entry for entry in now.points.values() if entry.role is Role.SETTING]
        assert all(entry.raw == held[entry.point] for entry in settings)
    assert not list(tmp_path.glob("*.undo-*"))


def enable(device: Connection) -> None:
    """Set it running, as its protocol does; a controller's loops are in automatic from the start."""
    for steps in (
        [("control_word", 6), ("control_word", 7), ("control_word", 15)],
        [("drive_enable", 1)],
    ):
        with contextlib.suppress(errors.Error):
            for point, value in steps:
                device.write(point, value, verify=False, force=True)


def test_a_device_that_vanishes_in_the_middle(bench: Bench) -> None:
    with bench.connect() as device:
        before = backup(device)
        change(device, settings_of(device, 10, seed=8))
        planned = plan(device, before)
        verdicts = carry_out(device, planned)
        done = [next(item for item in verdicts if item.verdict is Verdict.RESTORED)]
        bench.line.devices.clear()
        rest = [item for item in verdicts if item.step.action is Action.WRITE]
    assert len(done + rest) == 10
    assert rest[0].verdict is Verdict.NOT_WRITTEN, "its old value could not be read"
    assert {item.verdict for item in rest} == {Verdict.NOT_WRITTEN}
    assert all(isinstance(item.error, errors.NoReply) for item in rest)


def test_a_backup_of_a_device_that_does_not_answer_leaves_no_file(
    bench: Bench, tmp_path: Path
) -> None:
    bench.line.devices.clear()
    done = multidrop("backup", bench.name, "-o", str(tmp_path / "a.toml"), *bench.options)
    assert done.status == 4
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith("a")] == ["audit"] * 0


def test_passports_that_do_not_fit(bench: Bench, tmp_path: Path) -> None:
    good = tmp_path / "good.toml"
    with bench.connect() as device:
        made = backup(device)
        save(made, good)
        changed = settings_of(device, 1, seed=9)[0]
    entry = made.points[changed.text]
    cases = {
        "another model": replace(made, profile="ax-v"),
        "profile version": replace(made, profile_version="0"),
        "value": replace(
            made, points={**made.points, entry.point: replace(entry, value="nonsense")}
        ),
    }
    for name, passport in cases.items():
        path = tmp_path / f"{name}.toml"
        save(passport, path)
        done = multidrop("restore", str(path), bench.name, "--yes", "--while-enabled", *bench.options)  # fmt: skip
        assert done.status == 2, name
        assert "nothing was written" in done.err
    bent = tmp_path / "bent.toml"
    bent.write_text(good.read_text().replace("address = 3", "address = 4"))
    done = multidrop("restore", str(bent), bench.name, "--yes", *bench.options)
    assert done.status == 2
    assert "checksum does not fit" in done.err
    with bench.connect() as device:
        assert list(differences(made, backup(device))) == []


def test_unknown_points_are_skipped_by_rule(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    with bench.connect() as device:
        made = backup(device)
    strange = Entry("no such point", "x", Role.SETTING, 1, None, "int16", "0100")
    save(replace(made, points={**made.points, strange.point: strange}), path)
    out = bench.run("restore", str(path), bench.name, "--dry-run")
    assert "not in the profile" in out
