"""Discovery of simulated devices of every protocol, through real sockets."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from integration.processes import Address, multidrop, running
from integration.threads import served
from multidrop.catalog import load_profile
from multidrop.errors import NoReply, UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.io.connection import Connection, connect
from multidrop.profile import PointDescription, Profile
from multidrop.protocols import PROTOCOLS, datalink, slink3
from multidrop.protocols.datalink import Frame
from multidrop.sim.controller import Controller
from multidrop.sim.datalink import SimulatedInstrument
from multidrop.sim.devices import simulated_device
from multidrop.sim.faults import Fault, RandomFaults
from multidrop.sim.line import LineFaults, Pace, SimulatedLine
from multidrop.sim.slink3 import Parameters, SimulatedSlave
from multidrop.tools.profiles.discover import Discovery, discover, spread
from multidrop.tools.profiles.discovery_state import State

TYPES = ("int16", "uint16", "int32", "uint32", "float32", "string")
DRIVE = Profile(
    "drive",
    "slink3",
    dialect="flexmax",
    points={
        f"p{index}": PointDescription(f"p{index}", f"{index}:{TYPES[index // 3 % 6]}")
        for index in range(9000, 9060, 3)
    },
)


@contextlib.contextmanager
def on_a_line(
    profile: Profile, faults: LineFaults | None = None, pace: Pace | None = None
) -> Iterator[Address]:
    line = PROTOCOLS[profile.protocol].line
    device = simulated_device(profile, 1)
    with served(SimulatedLine([device], line.decoder, pace=pace, faults=faults)) as address:
        yield address


@contextlib.contextmanager
def connected(address: Address, profile: str) -> Iterator[Connection]:
    with connect(address.device(f"{profile}:1", timeout=0.2)) as connection:
        yield connection


def places(profile: Profile) -> set[str]:
    return {item.at for item in profile.points.values()}


def test_a_flexmax_whose_list_nobody_has(tmp_path: Path) -> None:
    with on_a_line(DRIVE) as address:
        device = address.device("flexmax:1")
        ran = multidrop("discover", device, "8990..9070", "-o", "found.toml", cwd=tmp_path)
    assert (ran.status, ran.out.splitlines()[0][:33]) == (0, "found.toml: 20 points found: 4 in")
    found = load_profile(str(tmp_path / "found.toml"))
    known = load_profile("flexmax").points
    assert places(found) == places(DRIVE) | {item.at for item in known.values()}
    assert found.points["index_9003"].role == "unknown"
    assert found.points["status_word"] == known["status_word"], "what was known elsewhere stays"
    assert (found.name, found.dialect) == ("found", "flexmax")
    assert sorted(path.name for path in tmp_path.glob("*found*")) == ["found.toml"]


@pytest.mark.parametrize("name", ["53mc5000", "ultra3000", "ax-v", "dgfc386"])
def test_what_a_shipped_profile_knows_is_found(name: str) -> None:
    profile = load_profile(name)
    where = {"ax-v": "1000..1200", "dgfc386": "500..520"}.get(name)
    with on_a_line(profile) as address, connected(address, name) as connection:
        found = discover(connection, where)
    assert set(profile.points.items()) <= set(found.points.items())


def test_an_ultra3000_that_nobody_knows(tmp_path: Path) -> None:
    known = load_profile("ultra3000")
    bare = tmp_path / "bare.toml"
    bare.write_text('[profile]\nname = "bare"\nprotocol = "ultra3000"\n')
    with on_a_line(known) as address, connected(address, str(bare)) as connection:
        found = discover(connection)
    by_place = {item.at: item for item in found.points.values()}
    for item in known.points.values():
        if "0" not in item.functions:
            assert item.at not in by_place, "an action does not show itself"
            continue
        assert by_place[item.at].elements == item.elements
        if "8" in item.functions and "9" in item.functions:
            low = None if item.minimum is None else item.unscaled(item.minimum)
            assert low in (None, by_place[item.at].minimum)
            assert by_place[item.at].type in (item.type or "").split("|")


def test_json(tmp_path: Path) -> None:
    with on_a_line(DRIVE) as address:
        device = address.device("flexmax:1")
        ran = multidrop("discover", device, "9000..9002", "-o", "a.toml", "--json", cwd=tmp_path)
    before, after = ran.objects
    assert (before["places"], before["left"], ran.err) == (3, 2, "")
    assert (after["found"], after["known"], after["unanswered"]) == (1, 0, [])
    assert after["file"] == "a.toml"


def test_the_time_is_said_before(tmp_path: Path) -> None:
    """On a paced line, where 2,000 indices take a minute, of which here are fewer."""
    pace = Pace(PROTOCOLS["slink3"].line.character, answer_delay=0.003)
    with on_a_line(DRIVE, pace=pace) as address, connected(address, "flexmax") as connection:
        run = Discovery(connection, "9000..9255")
        seconds = run.estimate()
        left = len(run.left)
    assert left == 256 - 64, "what they take differs much, so a quarter is looked at first"
    # 11 and 8 characters, or 11 and up to 13, several times; 3 ms, and the gap
    assert left * 0.020 < seconds < left * 0.060


@pytest.mark.parametrize(("places", "count"), [(1, 1), (2000, 250), (65536, 256), (0, 0)])
def test_what_is_looked_at_first_is_spread(places: int, count: int) -> None:
    chosen = spread(range(places), count)
    assert len(set(chosen)) == count
    assert [place * count // places for place in chosen] == list(range(count))


# -- interrupted -------------------------------------------------------------------------------


def test_an_interrupted_discovery_goes_on(tmp_path: Path) -> None:
    pace = Pace(0.0004, answer_delay=0.002)
    out = str(tmp_path / "found.toml")
    with on_a_line(DRIVE, pace=pace) as address:
        arguments = ("discover", address.device("flexmax:1"), "8900..9099", "-o", out)
        with running(*arguments) as program:
            program.wait_for("8900 to 9099: about")
            ended = program.interrupt()
        assert ended.status == 130
        assert "the same command with --resume goes on" in ended.err
        state = tmp_path / "found.toml.unfinished"
        kept = len(state.read_text().splitlines()) - 1
        assert 25 <= kept < 200
        assert not Path(out).exists()

        again = multidrop(*arguments)
        assert (again.status, "--resume goes on with it" in again.err) == (2, True)
        other = multidrop(*arguments[:2], "0..9", "-o", out, "--resume")
        assert (other.status, "is of another discovery: range '8900..9099'" in other.err) == (
            2,
            True,
        )

        state.write_bytes(state.read_bytes() + b'{"place": 90')  # as a power failure leaves it
        ran = multidrop(*arguments, "--resume", "--json")
    assert ran.status == 0
    assert ran.objects[-1]["looked"] == 200
    assert not state.exists()
    assert places(load_profile(out)) >= places(DRIVE)


def test_a_device_that_has_gone_leaves_what_was_found(tmp_path: Path) -> None:
    state = tmp_path / "state"
    slave = SimulatedSlave(1, slink3.FLEXMAX, Parameters({}))
    with (
        served(SimulatedLine([slave], slink3.decoder)) as address,
        connected(address, "flexmax") as connection,
    ):
        with State(state, {"range": None}) as kept:
            run = Discovery(connection, "9000..9020", note=kept.add)
            looked = run.run()
            while next(looked) < 9010:
                pass
            slave.slave.address = 2
            with pytest.raises(NoReply):
                list(looked)
        assert len(run.failed) == 3, "it is not asked for each of thousands"
        slave.slave.address = 1
        with State(state, {"range": None}, resume=True) as kept:
            assert sorted(kept.found) == list(range(9000, 9011))
            run = Discovery(connection, "9000..9020", found=kept.found)
            assert list(run.run()) == list(range(9011, 9021))


class Partly(SimulatedInstrument):
    """An instrument that does not answer for some of its memory."""

    def receive(self, events: list[FrameReceived[Frame] | Damaged], now: float) -> list[bytes]:
        liked = [
            event
            for event in events
            if isinstance(event, FrameReceived) and not 0x300 <= event.frame.memory_address < 0x380
        ]
        return super().receive(list(liked), now)


def test_silence_about_some_of_its_memory_is_no_death() -> None:
    instrument = Partly(1, Controller(1))
    with served(SimulatedLine([instrument], datalink.decoder)) as address:
        device = address.device(
            "53mc5000:1", timeout=0.25, attempts=1
        )  # long for who answers at once
        with connect(device) as connection:
            run = Discovery(connection, "0x200..0x45F")
            assert len(list(run.run())) == 19 + 4
    assert run.summary().unanswered == tuple(
        f"mem/0x{place:04X}/32" for place in range(0x300, 0x380, 32)
    )
    found = run.profile("found").points
    assert "b255" in found
    assert "b256" not in found


def test_nobody_there(tmp_path: Path) -> None:
    with on_a_line(DRIVE) as address:
        device = address.device("flexmax:5", timeout=0.05)
        ran = multidrop("discover", device, "-o", "found.toml", cwd=tmp_path)
    assert ran.status == 4
    assert not list(tmp_path.glob("*found*"))


def test_a_line_that_is_bad_hides_nothing() -> None:
    chances = {Fault.NO_ANSWER: 0.05, Fault.WRONG_CHECKSUM: 0.05}
    faults = LineFaults(RandomFaults(chances, seed=3))
    with on_a_line(DRIVE, faults) as address, connected(address, "flexmax") as connection:
        found = discover(connection, "9000..9060")
    assert places(found) >= places(DRIVE)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no state of a discovery"),
        ("[]\n", "is of another discovery: it has no head"),
        ('{"v": 1, "range": null, "more": 1}\n', "is of another discovery: it says more"),
        ('{"v": 1, "range": null}\n{"place": "x"}\n', "no state of a discovery"),
        ('{"v": 1, "range": null}\nnothing\n', "no state of a discovery"),
    ],
)
def test_a_state_that_is_none(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "state"
    path.write_text(text)
    if not text:
        State(path, {"range": None}, resume=True).close()
        assert json.loads(path.read_text()) == {"v": 1, "range": None}
        return
    with pytest.raises(UsageError, match=said):
        State(path, {"range": None}, resume=True)
    assert path.read_text() == text


def test_what_was_cut_short_is_written_over(tmp_path: Path) -> None:
    path = tmp_path / "state"
    with State(path, {"range": None}) as state:
        state.add(1, [])
    path.write_bytes(path.read_bytes() + b'{"place": 2, "points": [{"name": "' + b"x" * 200)
    with State(path, {"range": None}, resume=True) as state:
        state.add(3, [PointDescription("a", "3:int16")])
    assert b"xx" not in path.read_bytes()
    with State(path, {"range": None}, resume=True) as state:
        assert state.found == {1: [], 3: [PointDescription("a", "3:int16")]}


def test_a_state_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nothing to go on with"):
        State(tmp_path / "state", {}, resume=True)
    with pytest.raises(UsageError, match="cannot be written"):
        State(tmp_path / "nowhere" / "state", {})
