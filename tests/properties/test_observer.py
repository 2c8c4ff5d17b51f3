"""What an observer finds, whatever is on the line; and what it finds of real conversations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import cycle
from typing import Any

import pytest
from choices import Choices
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import DataObject, SearchStrategy
from strategies import ROWS, SIZES, Row, cut

from multidrop import errors
from multidrop.catalog import load_profile
from multidrop.conversation import Conversation
from multidrop.exchange import Exchange
from multidrop.observer import Found, Observer
from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000
from multidrop.protocols.datalink.frame import MOST_DATA, Command
from multidrop.protocols.datalink.slave import Reply as Memory
from multidrop.protocols.slink3.messages import WRITES, StandardParameter
from multidrop.protocols.slink3.slave import Reply as Response
from multidrop.protocols.ultra3000.slave import Reply as Digits
from multidrop.session import Session
from multidrop.transaction import Damage, Heard, Kind, Stray, Transaction

# -- anything at all ---------------------------------------------------------------------------

DIGITS = "0123456789ABCDEF"


def _message(choices: Choices) -> datalink.Frame:
    command, address = choices.of(list(Command)), 2 + choices.to(1)
    if command is Command.ACKNOWLEDGE:
        return datalink.Frame(command, address)
    at, data = choices.of((0x72C, 0x50D, 0x7E7E)), choices.data(MOST_DATA)
    body = b"" if command is Command.INTERROGATE else data
    return datalink.Frame(command, address, at, len(data), body)


def _host_command(choices: Choices) -> ultra3000.Frame:
    return ultra3000.Frame(
        address=choices.of((0, 1, 255)),
        parameter=choices.of((0x02B, 0x06D, 0x06F, 0x86D)),
        function=choices.to(4),
        data=choices.of(("", "07"))
        if choices.flag()
        else "".join(choices.times(10, lambda choices: choices.of(DIGITS))),
    )


def _nothing(choices: Choices) -> Any:
    raise AssertionError("observers have no slaves")


def _row(name: str, frame: Callable[[Choices], Any], telling: bytes) -> Row:
    line = PROTOCOLS[name].line
    return Row(name, frame, bytes, line, telling, b"\xff", _nothing, _nothing, _nothing)


ALL = [
    ROWS[0],
    _row("datalink", _message, b"\x7e\x00\x83\xe3\x23"),
    _row("ultra3000", _host_command, b":\r0123456789ABCDEF"),
]
PROFILES = {
    "slink3": load_profile("flexmax"),
    "datalink": load_profile("53mc5000"),
    "ultra3000": load_profile("ultra3000"),
}

every_protocol = pytest.mark.parametrize("row", ALL, ids=str)


def new(name: str, addresses: range = range(4)) -> Observer:
    protocol, profile = PROTOCOLS[name], PROFILES[name]
    return Observer(protocol, protocol.line, dict.fromkeys(addresses, profile))


def heard_in(found: Found) -> Iterator[Heard]:
    if isinstance(found, Transaction):
        yield from found.frames
        if found.echo is not None:
            yield found.echo
    elif isinstance(found, Stray):
        yield found.heard


def raws(found: list[Found]) -> list[bytes]:
    """The bytes of everything found, sorted: what belongs together comes out together."""
    damage = [item.raw for item in found if isinstance(item, Damage)]
    return sorted(damage + [heard.raw for item in found for heard in heard_in(item)])


@every_protocol
@given(data=st.data(), sizes=SIZES)
def test_every_frame_comes_out_once(row: Row, data: DataObject, sizes: list[int]) -> None:
    observer, decoder, now = new(row.name, range(3)), row.decoder(), 10.0
    found: list[Found] = []
    events: list[Any] = []
    for piece in cut(data.draw(row.streams), sizes):
        now += len(piece) * row.line.character
        found += observer.receive_data(piece, now)
        events += decoder.receive_data(piece)
    found += observer.finish()
    assert raws(found) == sorted(event.raw for event in [*events, *decoder.silence()])


STEPS = st.lists(
    st.tuples(
        st.floats(0, 0.02) | st.floats(0, 2),  # s since the piece before
        st.booleans(),  # whether anybody asks for what is overdue
        st.sampled_from(["heard", "sent", "received", "damaged"]),
    ),
    min_size=1,
    max_size=8,
)


@every_protocol
@given(data=st.data(), sizes=SIZES, steps=STEPS)
def test_no_input_raises(
    row: Row, data: DataObject, sizes: list[int], steps: list[tuple[float, bool, str]]
) -> None:
    """At any time, from either side, with damage: every byte comes out, but line feeds and late echoes."""
    observer, now, size = new(row.name, range(2)), 10.0, 0
    found: list[Found] = []
    for piece, (pause, look, side) in zip(
        cut(data.draw(row.streams), sizes), cycle(steps), strict=False
    ):
        now += pause
        if look:
            found += observer.time_passed(now)
        sent = None if side == "heard" else side == "sent"
        found += observer.receive_data(piece, now, sent=sent, damaged=side == "damaged")
        size += len(piece)
    while observer.deadline < float("inf"):
        now = max(now, observer.deadline)
        found += observer.time_passed(now)
    assert observer.finish() == []
    skipped = size - sum(map(len, raws(found)))
    assert skipped == 0 or (skipped > 0 and (row.name == "ultra3000" or observer.echoes))


# -- conversations of a real master with a real slave ----------------------------------------------

Said = tuple[Kind, list[tuple[str, bytes]], int | None]
"""What a transaction was: its kind, points with bytes, and the code of a refusal."""


@dataclass
class Slink3Slave:
    """A slave with parameters that holds what is written, below 2000; the rest it refuses."""

    slave: slink3.Slave = field(default_factory=lambda: slink3.Slave(1, slink3.FLEXMAX))
    values: dict[tuple[int, int | None], bytes] = field(default_factory=dict)
    log: list[Said] = field(default_factory=list)

    def answer(self, data: bytes) -> bytes:
        return b"".join(self._answer(request) for request in self.slave.receive_data(data))

    def _answer(self, request: Any) -> bytes:
        parameter = request.parameter
        if parameter is None:
            self.log.append((Kind.STATUS, [], None))
            return self.slave.answer(request, Response(0, b"\x37\x02"))
        key = parameter.index, parameter.subindex
        standard = isinstance(parameter, StandardParameter)
        text = f"std/0x{key[0]:04X}" if standard else f"{key[0]}"
        text += "" if key[1] is None else f".{key[1]}"
        if key[0] == 1999:
            kind = Kind.WRITE if request.command in WRITES else Kind.READ
            said = [(text, request.value)] if kind is Kind.WRITE else []
            self.log.append((kind, said, 1))
            return self.slave.answer(request, Response(1))
        if request.command in WRITES:
            self.values[key] = request.value
            self.log.append((Kind.WRITE, [(text, request.value)], None))
            return self.slave.answer(request, Response())
        value = self.values.get(key, b"\x05\x00")
        self.log.append((Kind.READ, [(text, value)], None))
        return self.slave.answer(request, request.found(getattr(parameter, "type_code", 0), value))

    def check(self, found: Transaction, said: Said) -> None:
        values = [(point.text, sample.raw) for point, sample in found.meaning.values]
        code = found.meaning.refusal.code if found.meaning.refusal else None
        assert (found.meaning.kind, values, code) == said


@dataclass
class Instrument:
    """An instrument that applies what is acknowledged. Reads are noted with their bytes."""

    slave: datalink.Slave = field(default_factory=lambda: datalink.Slave(1))
    memory: bytearray = field(default_factory=lambda: bytearray(range(256)) * 256)
    log: list[tuple[Kind, int, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.memory[0x8002] = 6

    def answer(self, data: bytes) -> bytes:
        return b"".join(self._answer(request) for request in self.slave.receive_data(data))

    def _answer(self, request: Any) -> bytes:
        start, end = request.memory_address, request.memory_address + request.count
        if request.settled is not None:
            return self.slave.answer(request, request.settled)
        if request.acknowledged:
            self.memory[start:end] = request.changed(bytes(self.memory[start:end]))
            self.log.append((Kind.WRITE, start, bytes(self.memory[start:end])))
            return b""
        self.log.append((Kind.READ, start, bytes(self.memory[start:end])))
        return self.slave.answer(request, Memory(bytes(self.memory[start:end])))

    def check(self, found: Transaction, said: tuple[Kind, int, bytes]) -> None:
        """Every value is what its place in memory holds, and every byte that was read is in one."""
        kind, start, memory = said
        assert (found.meaning.kind, found.meaning.complete) == (kind, True)
        covered: set[int] = set()
        for point, sample in found.meaning.values:
            at = point.memory_address - start  # type: ignore[attr-defined]
            assert point.sample(memory[at:]) == sample  # type: ignore[attr-defined]
            covered |= set(range(at, at + point.count))  # type: ignore[attr-defined]
        assert covered == set(range(len(memory)))


@dataclass
class Drive:
    """A drive that holds what is written."""

    slave: ultra3000.Slave = field(
        default_factory=lambda: ultra3000.Slave(1, profile=PROFILES["ultra3000"])
    )
    values: dict[tuple[int, int | None], str] = field(default_factory=dict)
    log: list[Said] = field(default_factory=list)

    def answer(self, data: bytes) -> bytes:
        return b"".join(self._answer(request) for request in self.slave.receive_data(data))

    def _answer(self, request: Any) -> bytes:
        key = request.parameter, request.element
        text = f"0x{key[0]:03X}" + ("" if key[1] is None else f".{key[1]}")
        writes = request.function in (1, 3)
        text += {2: "@nv", 3: "@nv", 8: "@min", 9: "@max"}.get(request.function, "")
        kind = Kind.WRITE if writes else Kind.READ
        if request.settled is not None:
            code = request.settled.refusal
            values = [(text, request.value.encode())] if writes else []
            self.log.append((kind, values, code))
            return self.slave.answer(request, request.settled)
        if writes:
            self.values[key] = request.value
        value = self.values.get(key, "0000" if key[0] == 0x037 else "00000000")
        self.log.append((kind, [(text, value.encode())], None))
        return self.slave.answer(request, Digits(0, value))

    check = Slink3Slave.check


@dataclass(frozen=True)
class Talk:
    """A protocol's slave, and what a master may say to it."""

    name: str
    slave: Callable[[], Any]
    sayings: SearchStrategy[Callable[[Any], Conversation[Any, Any]]]

    def __repr__(self) -> str:
        return self.name


def _read(text: str) -> Callable[[Any], Conversation[Any, Any]]:
    return lambda device: device.read(device.point(text))


def _write(text: str, value: int) -> Callable[[Any], Conversation[Any, Any]]:
    return lambda device: device.write(device.prepare_write(text, value, force=True))


def _group(text: str) -> Callable[[Any], Conversation[Any, Any]]:
    return lambda device: device.read_group(device.points(text))


def _sayings(reads: list[str], writes: list[str], *more: Any) -> SearchStrategy[Any]:
    return (
        st.sampled_from(reads).map(_read)
        | st.builds(_write, st.sampled_from(writes), st.integers(0, 1) | st.integers(0, 30000))
        | st.sampled_from(list(more))
    )


TALKS = [
    Talk(
        "slink3",
        Slink3Slave,
        _sayings(
            ["8236:int16", "1000:uint16", "1000.3:int16", "std/0x6044.0:int16", "1999:int16"],
            ["8236:int16", "1000.3:int16", "std/0x6042.0:int16", "1999:int16"],
            lambda device: device.master.status_word(),
        ),
    ),
    Talk(
        "datalink",
        Instrument,
        _sayings(
            ["C100", "L107", "B700", "H3", "A8", "F621", "mem/0x4000/9", "C767"],
            ["C100", "C101", "H3"],
            _group("C100..C103"),
            _group("C700..C709"),
            _write("L112", 1),
            _write("L112", 0),
            _write("B335", 7),
        ),
    ),
    Talk(
        "ultra3000",
        Drive,
        _sayings(
            ["0x06D", "0x02B.3", "0x037@nv", "setpoint_velocity"],
            ["0x06D", "0x02B.3", "0x02B.7@nv", "0x037"],
            _write("0x037", 7),
        ),
    ),
]


@pytest.mark.parametrize("talk", TALKS, ids=str)
@pytest.mark.parametrize("side", ["listener", "master", "master with echo"])
@given(data=st.data())
def test_conversations_are_observed_as_they_were(talk: Talk, side: str, data: DataObject) -> None:
    protocol = PROTOCOLS[talk.name]
    profile = PROFILES[talk.name]
    slave = talk.slave()
    device = protocol.device(1, profile, {})
    line = Wire(protocol.line, slave, new(talk.name), side, data.draw(SIZES))
    for saying in data.draw(st.lists(talk.sayings, max_size=4)):
        with suppress(errors.Error):
            line.run(saying(device))
    found = [*line.found, *line.observer.finish()]
    assert [type(item) for item in found] == [Transaction] * len(slave.log)
    for item, said in zip(found, slave.log, strict=True):
        slave.check(item, said)
        assert (item.echo is None) == (side != "master with echo")  # type: ignore[union-attr]
        if talk.name != "datalink":
            assert item.answer_ms == pytest.approx(5)  # type: ignore[union-attr]


class Wire:
    """A faultless line between a master and a slave that answers after 5 ms, with an observer on it."""

    def __init__(
        self, settings: Any, slave: Any, observer: Observer, side: str, sizes: list[int]
    ) -> None:
        self.settings = settings
        self.slave = slave
        self.observer = observer
        self.found: list[Found] = []
        self.now = 10.0
        self._listens, self._echoes = side == "listener", side == "master with echo"
        self._sizes = sizes
        self._session: Session[Any] = Session(settings.decoder(), settings.timing(network=False))

    def run(self, conversation: Conversation[Any, Any]) -> Any:
        exchange = Exchange(conversation, self._session)
        to_send = exchange.start(self.now)
        while True:
            answer = b""
            if to_send:
                answer = self.slave.answer(to_send)
                self._pass(to_send, True)
                if self._echoes:
                    self.found += self.observer.receive_data(to_send, self.now, sent=False)
                    to_send = exchange.advance(to_send, self.now)
                    if to_send:  # behind an Acknowledge, which nobody answers
                        continue
            if exchange.done:
                return exchange.result()
            if answer:
                self.now += 0.005
                self._pass(answer, False)
            else:
                self.now = max(self.now, exchange.deadline)
            to_send = exchange.advance(answer, self.now)

    def _pass(self, data: bytes, sent: bool) -> None:
        """The bytes go over the wire, and an observer gets them in pieces."""
        if sent and not self._listens:
            self.found += self.observer.receive_data(data, self.now, sent=True)
            self.now += len(data) * self.settings.character
            return
        for piece in cut(data, self._sizes):
            self.now += len(piece) * self.settings.character
            side = None if self._listens else False
            self.found += self.observer.receive_data(piece, self.now, sent=side)
