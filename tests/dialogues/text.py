"""Dialogues as text: the parser. `README.md` tells people how to write them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent


class BadDialogue(Exception):
    """A line of a dialogue cannot be understood."""


@dataclass(frozen=True)
class Sends:
    """`> bytes`: the master sends exactly these."""

    where: str
    raw: bytes


@dataclass(frozen=True)
class Delivers:
    """`< bytes`: the line delivers these, all at once; `!37` is a 37h with a parity error."""

    where: str
    raw: bytes
    wrong: frozenset[int] = frozenset()  # positions of the bytes with a parity error

    @property
    def marked(self) -> bytes:
        """The bytes as a port delivers them that marks parity errors: FFh 00h before a wrong one."""
        marked = b""
        for at, byte in enumerate(self.raw):
            front = b"\xff\x00" if at in self.wrong else b"\xff" if byte == 0xFF else b""
            marked += front + bytes((byte,))
        return marked


@dataclass(frozen=True)
class Passes:
    """`~ ms` or `~ ms..ms`: time passes in which the master says nothing."""

    where: str
    least: float  # s
    most: float | None  # s; None: as long as `least` and the usual allowance


@dataclass(frozen=True)
class Returns:
    """`= text` or `= path: text`: what the conversation returns."""

    where: str
    path: str
    text: str


@dataclass(frozen=True)
class Fails:
    """`! Class part of the message`: the error that the conversation raises."""

    where: str
    error: str
    part: str


Line = Sends | Delivers | Passes


@dataclass(frozen=True)
class Scene:
    """One conversation: what the line does before it, what is run, what passes, how it ends."""

    before: tuple[Line, ...]
    run: str
    lines: tuple[Line, ...]
    ends: tuple[Returns | Fails, ...]


@dataclass(frozen=True)
class Dialogue:
    """Scenes that follow each other on one line with one device."""

    protocol: str
    file: str
    title: str
    device: str  # PROFILE:ADDRESS
    options: dict[str, str]
    points: tuple[str, ...]
    scenes: tuple[Scene, ...]

    def __str__(self) -> str:
        return f"{self.protocol}/{self.file}: {self.title}"

    @property
    def seconds(self) -> float:
        """The least time that the dialogue takes, without its bytes."""
        lines = [line for scene in self.scenes for line in scene.before + scene.lines]
        return sum(line.least for line in lines if isinstance(line, Passes))


def load_dialogues(protocol: str | None = None) -> list[Dialogue]:
    """All dialogues, or those of one protocol, in the order of their files."""
    found = []
    for path in sorted(HERE.glob(f"{protocol or '*'}/*.txt")):
        found += parse(path.read_text(encoding="utf-8"), path.parent.name, path.name)
    return found


def parse(text: str, protocol: str, file: str) -> list[Dialogue]:
    """The dialogues of one file. Raises `BadDialogue` that names file and line."""
    head, *parts = re.split(r"^== ", text, flags=re.MULTILINE)
    common = _headers(_lines(head, f"{protocol}/{file}", 1))
    number = 1 + head.count("\n")
    dialogues = []
    for part in parts:
        title, _, body = part.partition("\n")
        lines = _lines(body, f"{protocol}/{file}", number + 1)
        number += part.count("\n")
        dialogues.append(_dialogue(protocol, file, title.strip(), lines, common))
    return dialogues


Numbered = list[tuple[str, str]]  # (file:line, text) without comments and blank lines
Headers = list[tuple[str, str]]  # (key, text)


def _lines(text: str, file: str, first: int) -> Numbered:
    found = []
    for number, line in enumerate(text.splitlines(), first):
        line = re.sub(r"(^|\s\s+)#.*", "", line).strip()
        if line:
            found.append((f"{file}:{number}", line))
    return found


def _headers(lines: Numbered) -> Headers:
    found = []
    for where, line in lines:
        key, colon, text = line.partition(":")
        if not colon or key not in ("device", "options", "point"):
            raise BadDialogue(f"{where}: {line!r} is not device:, options: or point:")
        found.append((key, text.strip()))
    return found


def _dialogue(protocol: str, file: str, title: str, lines: Numbered, common: Headers) -> Dialogue:
    first = next((at for at, (_, line) in enumerate(lines) if line.startswith("run:")), len(lines))
    headers = common + _headers(lines[:first])
    devices = [text for key, text in headers if key == "device"]
    scenes = _scenes(lines[first:])
    if not devices or not scenes:
        raise BadDialogue(f"{protocol}/{file}, {title}: it needs a device: and a run:")
    return Dialogue(
        protocol,
        file,
        title,
        device=devices[-1],
        options=dict(
            pair.split("=", 1) for key, text in headers if key == "options" for pair in text.split()
        ),
        points=tuple(text for key, text in headers if key == "point"),
        scenes=tuple(scenes),
    )


def _scenes(lines: Numbered) -> list[Scene]:
    """`run:`, lines, ends; lines that follow the ends come before the next `run:`."""
    scenes: list[Scene] = []
    before: list[Line] = []
    passed: list[Line] = []
    ends: list[Returns | Fails] = []
    run = where = ""
    for where, line in lines:
        item = line[4:].strip() if line.startswith("run:") else _item(where, line)
        if ends and not isinstance(item, Returns | Fails):
            scenes.append(Scene(tuple(before), run, tuple(passed), tuple(ends)))
            before, passed, ends, run = [], [], [], ""
        if isinstance(item, str):
            if run:
                raise BadDialogue(f"{where}: the run: before this one has no = and no !")
            run = item
        elif isinstance(item, Returns | Fails):
            ends.append(item)
        else:
            (passed if run else before).append(item)
        if not run and isinstance(item, Sends | Returns | Fails):
            raise BadDialogue(f"{where}: nothing runs here")
    if not ends and (run or before):
        raise BadDialogue(f"{where}: the last run: has no = and no !")
    if run:
        scenes.append(Scene(tuple(before), run, tuple(passed), tuple(ends)))
    return scenes


def _item(where: str, line: str) -> Line | Returns | Fails:
    mark, text = line[0], line[1:].strip()
    if mark in "<>":
        return _bytes(where, mark, text)
    if mark == "~":
        found = re.fullmatch(r"([\d.]+?)(?:\.\.([\d.]+))?", text)
        if found is None:
            raise BadDialogue(f"{where}: {text!r} is not a time in ms, such as 20 or 1515..1525")
        return Passes(where, float(found[1]) / 1000, float(found[2]) / 1000 if found[2] else None)
    if mark == "=":
        found = re.fullmatch(r"([\w.]+):(?: (.*))?", text)
        return Returns(where, found[1], found[2] or "") if found else Returns(where, "", text)
    if mark == "!":
        error, _, part = text.partition(" ")
        return Fails(where, error, part.strip())
    raise BadDialogue(f"{where}: {line!r} begins with none of < > ~ = ! run:")


def _bytes(where: str, mark: str, text: str) -> Sends | Delivers:
    words = text.split()
    wrong = frozenset(at for at, word in enumerate(words) if word.startswith("!"))
    try:
        raw = bytes(_byte(word.removeprefix("!")) for word in words)
    except ValueError:
        raise BadDialogue(f"{where}: {text!r} is not hex bytes") from None
    if mark == "<":
        return Delivers(where, raw, wrong)
    if wrong:
        raise BadDialogue(f"{where}: a master sends no parity errors")
    return Sends(where, raw)


def _byte(word: str) -> int:
    (byte,) = bytes.fromhex(word)
    return byte
