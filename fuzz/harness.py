"""A coverage-guided fuzzer for the receive loop and both sides of any protocol.

`fuzz(target)` takes over: it reads libFuzzer's options from the command line
and ends the process. Only `multidrop.errors` may come out of the code under
test, and none of it from a decoder or a slave.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import atheris

with atheris.instrument_imports(include=["multidrop"]):
    from multidrop import errors
    from multidrop.events import FrameReceived
    from multidrop.exchange import Exchange
    from multidrop.session import Session
    from multidrop.timing import LineSettings

Provider = Any  # atheris.FuzzedDataProvider: values from the fuzzer's bytes

MOST_STEPS = 1000
"""An exchange on a silent line ends in fewer."""


REPORT_EVERY = 10_000
"""Inputs between two reports of how often each of the three was tried."""


@dataclass(frozen=True)
class Target:
    """A protocol as the fuzzer needs it; each function takes what it chooses from the bytes."""

    line: LineSettings
    frame: Callable[[Provider, Any], bytes]  # a whole frame; given what was sent, maybe its answer
    slave: Callable[[Provider], Any]
    reply: Callable[[Provider], Any]
    conversation: Callable[[Provider], Any]
    seeds: Iterable[bytes] = ()
    skips: bytes = b""  # what a receiver passes over behind a frame, if nothing follows it


def piece(data: Provider, target: Target, sent: bytes) -> bytes:
    """The next bytes on the line: anything, or a whole frame, perhaps with an end that is none."""
    if data.ConsumeBool():
        return bytes(data.ConsumeBytes(data.ConsumeIntInRange(0, 40)))
    raw = target.frame(data, sent)
    cut_short = data.ConsumeIntInRange(0, 7) == 7
    return raw[: data.ConsumeIntInRange(0, len(raw))] if cut_short else raw


def fuzz_decoder(data: Provider, target: Target) -> None:
    """Every byte comes out once, and the same however the stream was cut.

    After silence the next frame is found, as by a decoder that has heard nothing before;
    and a frame that was read is the one that is written.
    """
    decoder, whole = target.line.decoder(), target.line.decoder()
    following = target.frame(data, b"")
    stream, events = b"", []
    while data.remaining_bytes():
        part = piece(data, target, b"")
        stream += part
        events += decoder.receive_data(part)
    events += decoder.silence()
    found = b"".join(event.raw for event in events)
    assert found == stream or found + target.skips == stream
    assert whole.receive_data(stream) + whole.silence() == events
    for event in events:
        if isinstance(event, FrameReceived):
            assert type(event.frame).decode(event.frame.encode()) == event.frame
    fresh = target.line.decoder()
    assert decoder.receive_data(following) == fresh.receive_data(following)


def fuzz_slave(data: Provider, target: Target) -> None:
    """Whatever comes, the slave answers whole frames or nothing."""
    slave, reply = target.slave(data), target.reply(data)
    while data.remaining_bytes():
        requests = slave.receive_data(piece(data, target, b""))
        if data.ConsumeBool():
            requests += slave.silence()
        for request in requests:
            answer = slave.answer(request, request.settled or reply)
            kinds = [type(event) for event in target.line.decoder().receive_data(answer)]
            assert kinds == [FrameReceived] * bool(answer)


def fuzz_exchange(data: Provider, target: Target) -> None:
    """Whatever answers come, and whenever: every conversation ends, with a result or an error."""
    timing = target.line.timing(network=data.ConsumeBool())
    session: Session[Any] = Session(
        target.line.decoder(), timing, echo=data.PickValueInList([None, True, False])
    )
    slave, reply = target.slave(data), target.reply(data)
    exchange = Exchange(target.conversation(data), session)
    now = 1.0
    sent = exchange.start(now)
    while data.remaining_bytes() and not exchange.done:
        heard = b""
        if data.ConsumeBool():
            for request in slave.receive_data(sent):
                heard += slave.answer(request, request.settled or reply)
        if data.ConsumeBool():
            heard += piece(data, target, sent)
        now += data.ConsumeIntInRange(0, 2000) / 1000
        sent = exchange.advance(heard, now, damaged=bool(heard) and data.ConsumeProbability() > 0.9)
    for _ in range(MOST_STEPS):
        if exchange.done:
            break
        now = max(now, exchange.deadline)
        exchange.advance(b"", now)
    assert exchange.done, "it goes on for ever"
    with suppress(errors.Error):
        exchange.result()


def fuzz(*targets: Target) -> None:
    """Run until libFuzzer's options say enough; the input says which of the targets it is for."""

    tried = dict.fromkeys((fuzz_decoder, fuzz_slave, fuzz_exchange), 0)

    def one_input(raw: bytes) -> None:
        data = atheris.FuzzedDataProvider(raw)
        target = data.PickValueInList(list(targets))
        mode = list(tried)[data.ConsumeIntInRange(0, 2)]
        mode(data, target)
        tried[mode] += 1
        if not sum(tried.values()) % REPORT_EVERY:
            print(", ".join(f"{mode.__name__} {count}" for mode, count in tried.items()))

    with tempfile.TemporaryDirectory() as folder:
        for number, seed in enumerate(seed for target in targets for seed in target.seeds):
            Path(folder, str(number)).write_bytes(seed)
        inputs_to_repeat = any(Path(word).is_file() for word in sys.argv[1:])
        seeds = [] if inputs_to_repeat else [folder]
        atheris.Setup([*sys.argv, "-max_len=2048", "-timeout=20", *seeds], one_input)
        atheris.Fuzz()
