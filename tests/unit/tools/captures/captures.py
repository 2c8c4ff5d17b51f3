"""Captures for tests: what a master and two slaves say, with everything that can go wrong."""

from __future__ import annotations

import random
from pathlib import Path

from multidrop.io.capture import CaptureWriter, Known
from multidrop.protocols import PROTOCOLS, slink3

SLINK3 = PROTOCOLS["slink3"]
LINE = slink3.LINE
NOON = 1_700_000_000_000_000_000
"""ns; 2023-11-14 22:13:20 UTC."""


def question(address: int, number: int, index: int = 1009) -> slink3.Frame:
    data = bytes((0, index & 0xFF, index >> 8))
    return slink3.Frame(address, 0, 0, 0x26, data).numbered(number)


def answer(asked: slink3.Frame, value: int) -> slink3.Frame:
    data = b"\x03" + asked.data[1:] + value.to_bytes(2, "little")
    return slink3.Frame(asked.address, asked.control, 1, 0, data)


def refusal(asked: slink3.Frame, code: int = 1) -> slink3.Frame:
    return slink3.Frame(asked.address, asked.control, 1, code)


class Talk:
    """Writes a conversation into a capture, frame by frame."""

    def __init__(self, path: Path, *devices: Known, sent: bool | None = None) -> None:
        self.writer = CaptureWriter.create(path)
        self.line = self.writer.add_line(SLINK3, LINE, "/dev/ttyUSB0", devices)
        self.now = NOON
        self._sent = sent

    def say(self, frame: slink3.Frame, after: float = 0.003) -> None:
        """A frame that begins `after` s behind the last one."""
        raw = frame.encode()
        self.now += round((after + len(raw) * LINE.character) * 1e9)
        sent = None if self._sent is None else not frame.is_answer
        self.writer.add(self.line, raw, self.now, sent=sent)

    def spoil(self, raw: bytes, reason: str = "no START") -> None:
        self.now += round(len(raw) * LINE.character * 1e9)
        self.writer.add(self.line, raw, self.now, damage=reason)

    def close(self) -> None:
        self.writer.close()


def busy(path: Path, transactions: int, *, faults: bool = True) -> None:
    """A line on which two slaves are read, with refusals, silence and damage now and then."""
    dice = random.Random(7)
    talk = Talk(path, Known(1, "flexmax", "infeed"), Known(2, "ax-v"))
    for number in range(transactions):
        asked = question(1 + number % 2, number % 16, 1009 if number % 2 else 8236)
        talk.say(asked)
        fate = dice.random() if faults else 1.0
        if fate < 0.05:
            talk.say(refusal(asked), 0.004)
        elif fate < 0.10:
            talk.now += 100_000_000
        elif fate < 0.13:
            talk.spoil(answer(asked, 1).encode()[:-1] + b"\xff", "checksum FFh, computed 00h")
        elif fate < 0.16:
            talk.say(answer(question(3, number % 16), 5))
        else:
            talk.say(answer(asked, number % 30000), 0.005)
    talk.close()
