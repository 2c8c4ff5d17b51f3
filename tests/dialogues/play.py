"""Plays dialogues: the script as the other end of the wire, and the conversation that is run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Any, Protocol

from dialogues.text import Delivers, Dialogue, Fails, Line, Passes, Returns, Scene, Sends
from multidrop import errors
from multidrop.catalog import load_profile
from multidrop.conversation import Conversation
from multidrop.device import Report
from multidrop.exchange import Exchange
from multidrop.io.parity import ParityMarks
from multidrop.naming import LineOptions
from multidrop.points import Role
from multidrop.profile import PointDescription, Profile
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.slink3.values import FORMATS_BY_TYPE_NAME
from multidrop.session import Session
from multidrop.timing import LineSettings

ALLOWANCE = 0.050
"""s that a master may take beyond what `~` says: a gap, or a frame taken as cut short."""

FOREVER = float("inf")

WORDS: dict[str, dict[str, Any]] = {"slink3": dict(FORMATS_BY_TYPE_NAME)}
"""Words of each protocol that stand for a value in the arguments of a master's method."""


class Script:
    """The lines of a scene as the other end of a wire; raises `AssertionError` where they differ.

    `tolerance` is for stages whose clock is a real one.
    """

    def __init__(self, lines: Sequence[Line], character: float, tolerance: float = 1e-6) -> None:
        self._lines = list(lines)
        self._character = character
        self._tolerance = tolerance
        self._since = 0.0  # when the last byte went over the wire
        self._least = 0.0  # the master says nothing until then, counted from `_since`
        self._most = ALLOWANCE

    def begin(self, now: float) -> None:
        """The conversation starts at `now`."""
        self._passed(now)

    @property
    def deadline(self) -> float:
        """When the line delivers its next bytes; infinity for never."""
        if self._lines and isinstance(self._lines[0], Delivers):
            return self._since + self._least
        return FOREVER

    def receive(self, data: bytes, now: float) -> None:
        """The master sent `data`, starting at `now`."""
        expected = self._lines.pop(0) if self._lines else None
        if not isinstance(expected, Sends):
            what = expected.where if expected else "the end"
            raise AssertionError(f"{what}: the master sent {data.hex(' ').upper()}")
        shown = data.hex(" ").upper()
        assert data == expected.raw, f"{expected.where}: the master sent {shown}"
        self._in_time(expected.where, now)
        self._passed(now + len(data) * self._character)

    def send(self, now: float) -> bytes:
        """What a port that marks parity errors delivers at `now`: one `<` line, or nothing."""
        if now < self.deadline:
            return b""
        line = self._lines.pop(0)
        assert isinstance(line, Delivers)
        self._passed(now)
        return line.marked

    def finish(self, now: float) -> None:
        """The conversation ended at `now`."""
        if self._lines:
            raise AssertionError(f"{self._lines[0].where}: the conversation ended before this")
        self._in_time("the end", now)

    def _passed(self, now: float) -> None:
        self._since, self._least, self._most = now, 0.0, ALLOWANCE
        while self._lines and isinstance(self._lines[0], Passes):
            line = self._lines.pop(0)
            assert isinstance(line, Passes)
            self._most = self._least + (line.most or line.least + ALLOWANCE)
            self._least += line.least

    def _in_time(self, where: str, now: float) -> None:
        waited = now - self._since
        # a conversation may end while its last frame is still on the wire
        early = self._least > 0 and waited < self._least - self._tolerance
        late = waited > self._most + self._tolerance
        if early or late:
            raise AssertionError(
                f"{where}: after {waited * 1000:.1f} ms,"
                f" not {self._least * 1000:g}..{self._most * 1000:g} ms"
            )


class Stage(Protocol):
    """Where a dialogue is played: one line, kept from scene to scene."""

    def run(self, conversation: Conversation[Any, Any], script: Script) -> Any:
        """Carry out a conversation against `script`; returns and raises what it does.

        Calls `script.begin` before its first step and `script.finish` after its last.
        """
        ...

    def idle(self, seconds: float) -> None:
        """Nobody asks for so long."""
        ...

    def stray(self, marked: bytes) -> None:
        """Bytes arrive while nobody asks, with the port's marks."""
        ...


class ExchangeStage:
    """Plays on `Exchange` alone: the clock is a number."""

    def __init__(self, settings: LineSettings, options: LineOptions) -> None:
        self.now = 1000.0
        self._marks = ParityMarks()
        self.session: Session[Any] = Session(
            settings.decoder(), settings.timing(network=False), echo=options.hears_itself
        )

    def run(self, conversation: Conversation[Any, Any], script: Script) -> Any:
        exchange = Exchange(conversation, self.session)
        self.session.drain(b"", self.now)
        script.begin(self.now)
        to_send = exchange.start(self.now)
        while True:
            if to_send:
                script.receive(to_send, self.now)
            if exchange.told is not None:
                exchange.written(self.now)
            if exchange.done:
                break
            self.now = max(self.now, min(exchange.deadline, script.deadline))
            to_send = self._advance(exchange, script.send(self.now))
        script.finish(self.now)
        return exchange.result()

    def _advance(self, exchange: Exchange[Any, Any], marked: bytes) -> bytes:
        if not marked:
            return exchange.advance(b"", self.now)
        return b"".join(
            exchange.advance(piece, self.now, damaged=damaged)
            for piece, damaged in self._marks.split(marked)
        )

    def idle(self, seconds: float) -> None:
        self.now += seconds

    def stray(self, marked: bytes) -> None:
        for piece, damaged in self._marks.split(marked):
            self.session.drain(piece, self.now, damaged=damaged)


class Played:
    """What a dialogue runs: its device, the line's settings, and its conversations."""

    def __init__(self, dialogue: Dialogue) -> None:
        self.dialogue = dialogue
        self.protocol = PROTOCOLS[dialogue.protocol]
        profile, _, address = dialogue.device.partition(":")
        self.options = LineOptions.parse(dialogue.options, self.protocol.options)
        self.settings = self.protocol.line.with_options(**self.options.line_settings())
        self.profile = _with_points(load_profile(profile), dialogue)
        self.address = int(address or 0)

    @cached_property
    def device(self) -> Any:
        return self.protocol.device(self.address, self.profile, self.options.own)

    def conversation(self, run: str) -> Conversation[Any, Any]:
        """What a `run:` line stands for; raises what it raises at its first step."""
        return (yield from self._conversation(run))

    def _conversation(self, run: str) -> Conversation[Any, Any]:
        verb, *words = shlex.split(run)
        known: dict[str, Callable[[list[str]], Conversation[Any, Any]]] = {
            "read": lambda words: self.device.read(self.device.point(words[0])),
            "write": self._write,
            "status": lambda words: self.device.status(),
            "clear-faults": lambda words: self.device.clear_faults(),
            "reset-comm": lambda words: self.device.reset_comm(),
            "raw": lambda words: self.device.prepare_raw(" ".join(words))(),
            "broadcast": self._broadcast,
        }
        return known[verb](words) if verb in known else self._service(verb, words)

    def _write(self, words: list[str]) -> Conversation[Any, Any]:
        point, _, value = words[0].partition("=")
        write = self.device.prepare_write(point, value, force="force" in words)
        found: Conversation[Any, Any] = self.device.write(write, verify="no-verify" not in words)
        return found

    def _broadcast(self, words: list[str]) -> Conversation[Any, Any]:
        named = dict(word.split("=", 1) for word in words if "=" in word)
        verify = [int(text) for text in named.pop("verify", "").split(",") if text]
        return self.protocol.prepare_broadcast(
            self.profile,
            named.items(),
            verify,
            self.options.own,
            force="force" in words,
            keep_going="keep-going" in words,
        )()

    def _service(self, name: str, words: list[str]) -> Conversation[Any, Any]:
        """A method of the protocol's master, by its own name."""
        vocabulary = WORDS[self.dialogue.protocol]
        plain = [_argument(word, vocabulary) for word in words if "=" not in word]
        named = dict(word.split("=", 1) for word in words if "=" in word)
        method = getattr(self.device.master, name)
        found: Conversation[Any, Any] = method(
            *plain, **{key: _argument(text, vocabulary) for key, text in named.items()}
        )
        return found


def play(
    dialogue: Dialogue, make_stage: Callable[[Played], Stage], tolerance: float = 1e-6
) -> None:
    """Play all scenes; raises `AssertionError` at the first line that differs."""
    played = Played(dialogue)
    stage = make_stage(played)
    for scene in dialogue.scenes:
        for line in scene.before:
            if isinstance(line, Passes):
                stage.idle(line.least)
            else:
                assert isinstance(line, Delivers)
                stage.stray(line.marked)
        script = Script(scene.lines, played.settings.character, tolerance)
        try:
            result = stage.run(played.conversation(scene.run), script)
        except errors.Error as error:
            _check_error(scene, error)
        else:
            _check_result(scene, result)


def _with_points(profile: Profile, dialogue: Dialogue) -> Profile:
    """The profile with the points of `point:` lines, and with the roles of `role=` words, first."""
    own = [_point(text) for text in dialogue.points]
    for scene in dialogue.scenes:
        found = re.fullmatch(r"write (\S+?)=.* role=(\w+).*", scene.run)
        if found:
            own.append(PointDescription(found[1], found[1], Role(found[2])))
    return replace(profile, points={**{point.name: point for point in own}, **profile.points})


def _point(text: str) -> PointDescription:
    """`NAME key=value ...` with the keys of a profile's point."""
    name, *words = shlex.split(text)
    given: dict[str, Any] = dict(word.split("=", 1) for word in words)
    numbers = {"scale", "minimum", "maximum"} & given.keys()
    given.update({key: float(given[key]) for key in numbers})
    if "role" in given:
        given["role"] = Role(given["role"])
    return PointDescription(name, **given)


def _argument(text: str, vocabulary: dict[str, Any]) -> Any:
    if text in vocabulary:
        return vocabulary[text]
    if text.startswith("hex:"):
        return bytes.fromhex(text[4:])
    if text in ("yes", "no"):
        return text == "yes"
    try:
        return int(text, 0)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        return text


def _check_error(scene: Scene, error: errors.Error) -> None:
    end = scene.ends[0]
    name, text = type(error).__name__, str(error)
    if not isinstance(end, Fails):
        raise AssertionError(f"{end.where}: the conversation raised {name}: {text}") from error
    if end.error != name or end.part not in text:
        raise AssertionError(f"{end.where}: the conversation raised {name}: {text}") from error


def _check_result(scene: Scene, result: Any) -> None:
    for end in scene.ends:
        if isinstance(end, Fails):
            raise AssertionError(f"{end.where}: the conversation returned {result!r}")
        found = as_text(_at(result, end))
        pattern = ".*".join(re.escape(part) for part in end.text.split("..."))
        if re.fullmatch(pattern, found, re.DOTALL) is None:
            raise AssertionError(f"{end.where}: it is {found!r}")


def _at(result: Any, end: Returns) -> Any:
    """What stands at a path such as `0.written.0.outcome`: positions, fields, keys."""
    for step in end.path.split(".") if end.path else []:
        if isinstance(result, Report):
            result = result.fields[step]
        elif step.isdecimal():
            result = result[int(step)]
        elif hasattr(result, step):
            result = getattr(result, step)
        else:
            names = [field.name for field in fields(result)] if is_dataclass(result) else []
            raise AssertionError(f"{end.where}: there is no {step!r} in {result!r} {names}")
    return result


def as_text(value: Any) -> str:
    """A result as a dialogue writes it."""
    match value:
        case None:
            return "none"
        case bool():
            return "yes" if value else "no"
        case Enum():
            return str(value.value) if not isinstance(value, int) else str(int(value))
        case bytes():
            return value.hex(" ").upper() or "no bytes"
        case errors.Error():
            return f"{type(value).__name__} {value}"
        case list() | tuple() if type(value) in (list, tuple):
            return ", ".join(as_text(item) for item in value) or "nothing"
        case _:
            return str(value)
