"""Blocking and asyncio lines pass the same dialogues, on wires with a time of their own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from dialogues import Dialogue, Played, Script, load_dialogues, play

from integration.virtual_time import VirtualTimeLoop, WireTransport
from multidrop.conversation import Conversation
from multidrop.io.async_line import AsyncLine
from multidrop.io.line import Line
from multidrop.io.memory import FOREVER, MemoryPort
from multidrop.io.parity import ParityMarks


class ScriptedPeer:
    """The other end of a wire: one script after the other, and stray bytes between them."""

    def __init__(self) -> None:
        self.script: Script | None = None
        self.strays = b""

    def receive(self, data: bytes, now: float) -> None:
        assert self.script is not None
        self.script.receive(data, now)

    @property
    def deadline(self) -> float:
        if self.strays:
            return 0.0
        return self.script.deadline if self.script else FOREVER

    def send(self, now: float) -> bytes:
        data, self.strays = self.strays, b""
        return data or (self.script.send(now) if self.script else b"")


class BlockingStage:
    """A `Line` on a `MemoryPort`."""

    def __init__(self, played: Played) -> None:
        self._peer = ScriptedPeer()
        self._port = MemoryPort(self._peer, marks=True)
        self._line = Line(self._port, played.settings, played.options)

    def run(self, conversation: Conversation[Any, Any], script: Script) -> Any:
        self._peer.script = script
        script.begin(self._port.now())
        try:
            return self._line.run(conversation)
        finally:
            self._peer.script = None
            script.finish(self._port.now())

    def idle(self, seconds: float) -> None:
        assert self._port.read(seconds) == b""

    def stray(self, marked: bytes) -> None:
        self._peer.strays += marked


class AsyncStage:
    """An `AsyncLine` in a loop whose time only passes when nothing is left to do."""

    def __init__(self, played: Played, loop: VirtualTimeLoop) -> None:
        self._loop = loop
        self._peer = ScriptedPeer()
        self._line = loop.run_until_complete(self._made(played))

    async def _made(self, played: Played) -> AsyncLine:
        line = AsyncLine(played.settings, played.options, network=False)
        line.marks = ParityMarks()
        self._wire = WireTransport(self._peer, line)
        return line

    def run(self, conversation: Conversation[Any, Any], script: Script) -> Any:
        return self._loop.run_until_complete(self._run(conversation, script))

    async def _run(self, conversation: Conversation[Any, Any], script: Script) -> Any:
        self._peer.script = script
        script.begin(self._loop.time())
        self._wire.arm()
        try:
            return await self._line.run(conversation)
        finally:
            self._peer.script = None
            script.finish(self._loop.time())

    def idle(self, seconds: float) -> None:
        self._loop.pass_time(seconds)

    def stray(self, marked: bytes) -> None:
        self._line.data_received(marked)


@pytest.fixture
def loop() -> Iterator[VirtualTimeLoop]:
    made = VirtualTimeLoop()
    yield made
    made.close()


@pytest.mark.parametrize("dialogue", load_dialogues(), ids=str)
def test_dialogue_on_a_blocking_line(dialogue: Dialogue) -> None:
    play(dialogue, BlockingStage)


@pytest.mark.parametrize("dialogue", load_dialogues(), ids=str)
def test_dialogue_on_an_asyncio_line(dialogue: Dialogue, loop: VirtualTimeLoop) -> None:
    play(dialogue, lambda played: AsyncStage(played, loop))


def test_there_are_dialogues() -> None:
    assert len(load_dialogues("slink3")) > 100
