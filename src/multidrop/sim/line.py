"""A simulated line: devices, the time that bytes take, and faults. Time is an argument."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

from multidrop.decoder import Decoder
from multidrop.events import Damaged, FrameReceived
from multidrop.sim.faults import GAP, LATE, NOISE, Fault, Faults, NoFaults

FOREVER = float("inf")


class Later(NamedTuple):
    """An answer that its device takes so long for, in s."""

    answer: bytes
    after: float


class SimulatedDevice(Protocol):
    """One slave of a simulated line."""

    @property
    def address(self) -> int: ...

    def receive(
        self, events: list[FrameReceived[Any] | Damaged], now: float
    ) -> Sequence[bytes | Later]:
        """The answers to what the line's decoder found, ready to send."""
        ...

    def disguise(self, answer: bytes, fault: Fault) -> bytes:
        """The answer as another slave, or with another sequence number, would send it."""
        ...


@runtime_checkable
class Living(Protocol):
    """A simulated device in which something happens by itself."""

    def advance(self, now: float) -> None:
        """Let it happen until `now`."""
        ...


TICK = 0.1
"""s between two looks at what happens by itself."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long bytes take. `character` s each on the wire (0: none); `burst` s between deliveries.

    With `burst` the bytes of a time slot come together, as USB adapters and
    device servers deliver them; without, each byte comes by itself.
    """

    character: float = 0.0
    burst: float = 0.0
    answer_delay: float = 0.0  # s from the end of a request to the first byte of its answer


@dataclass(frozen=True, slots=True)
class LineFaults:
    """Faults of answers, how late a late one is, and whether the line hears itself."""

    faults: Faults
    late: float = LATE
    echo: bool = False


class SimulatedLine:
    """The devices of one line, and the wire that they share.

    `character` is the time of one at the line's baud rate. Also where bytes take
    no time, an answer that equals its request is not sent before the request
    could have left the wire: a master would rightly take it for an echo.
    """

    def __init__(
        self,
        devices: Iterable[SimulatedDevice],
        decoder: Callable[[], Decoder[Any]],
        *,
        silence: float = 0.3,
        character: float = 0.0,
        pace: Pace | None = None,
        faults: LineFaults | None = None,
    ) -> None:
        self.devices = list(devices)
        self.pace = pace or Pace()
        self.faults = faults or LineFaults(NoFaults())
        self.silence = silence
        self.character = character
        self._living = [device for device in self.devices if isinstance(device, Living)]
        self.tick_at = 0.0 if self._living else FOREVER  # when something happens by itself
        self.free_at = 0.0  # when the last byte on its way has passed
        self.ears: list[Callable[[bytes, float], None]] = []  # told of bytes, and when they passed
        self._decoder = decoder

    def tick(self, now: float) -> None:
        """Let happen what happens by itself."""
        for device in self._living:
            device.advance(now)
        self.tick_at = now + TICK

    def attach(self) -> Connection:
        """Another master's end of the line: each hears the answers to its own requests."""
        return Connection(self, self._decoder())


class Connection:
    """One end of a simulated line; a `Peer` for a port, a socket or a pseudo-terminal."""

    def __init__(self, line: SimulatedLine, decoder: Decoder[Any]) -> None:
        self._line = line
        self._decoder = decoder
        self._waiting: deque[tuple[float, bytes]] = deque()  # (due, bytes), in order
        self._cut_at = FOREVER

    def receive(self, data: bytes, now: float) -> None:
        line = self._line
        start = max(now, line.free_at)
        end = line.free_at = start + len(data) * line.pace.character
        for ear in line.ears:
            ear(data, end)
        if line.faults.echo:
            self._queue(data, start)
        self._answer(self._decoder.receive_data(data), end)
        self._cut_at = end + line.silence if self._decoder.pending else FOREVER

    @property
    def deadline(self) -> float:
        due = self._waiting[0][0] if self._waiting else FOREVER
        return min(due, self._cut_at, self._line.tick_at)

    def send(self, now: float) -> bytes:
        if now >= self._line.tick_at:
            self._line.tick(now)
        if now >= self._cut_at:
            self._cut_at = FOREVER
            self._answer(self._decoder.silence(), now)
        waiting = self._waiting
        if not waiting or waiting[0][0] > now:
            return b""
        out = []
        while waiting and waiting[0][0] <= now:
            out.append(waiting.popleft()[1])
        sent = b"".join(out)
        for ear in self._line.ears:
            ear(sent, now)
        return sent

    def _answer(self, events: list[FrameReceived[Any] | Damaged], now: float) -> None:
        if not events:
            return
        line = self._line
        for device in line.devices:
            for answer in device.receive(events, now):
                at = now + line.pace.answer_delay
                if isinstance(answer, Later):
                    answer, after = answer
                    at += after
                if not line.pace.character and any(answer == event.raw for event in events):
                    at += len(answer) * line.character
                self._reply(device, answer, at)

    def _reply(self, device: SimulatedDevice, answer: bytes, at: float) -> None:
        faults = self._line.faults
        fault = faults.faults.draw()
        if fault is Fault.NO_ANSWER:
            return
        if fault is Fault.LATE_ANSWER:  # the line is free until then
            self._put_bytes(answer, max(at, self._line.free_at) + faults.late)
            return
        if fault is Fault.WRONG_CHECKSUM:
            answer = answer[:-1] + bytes([answer[-1] ^ 0x55])
        elif fault is Fault.CUT_SHORT:
            answer = answer[: len(answer) // 2]
        elif fault is Fault.NOISE:
            answer = NOISE + answer
        elif fault is Fault.GAP:  # the line is free until the other half comes
            half = len(answer) // 2
            self._queue(answer[:half], max(at, self._line.free_at))
            self._put_bytes(answer[half:], self._line.free_at + GAP)
            return
        elif fault is Fault.TWICE:  # a second device with this address
            self._queue(answer, max(at, self._line.free_at))
        elif fault is not None:
            answer = device.disguise(answer, fault)
        self._queue(answer, max(at, self._line.free_at))

    def _queue(self, data: bytes, start: float) -> None:
        """Put bytes on the wire from `start` on; it is taken as long as they pass."""
        line = self._line
        line.free_at = max(line.free_at, start + len(data) * line.pace.character)
        self._put_bytes(data, start)

    def _put_bytes(self, data: bytes, start: float) -> None:
        """Each byte, or burst of them, with the time at which it has passed."""
        character, burst = self._line.pace.character, self._line.pace.burst
        if not character:
            self._put(start, data)
            return
        if not burst:
            for number in range(len(data)):
                self._put(start + (number + 1) * character, data[number : number + 1])
            return
        sent = 0
        end = start + len(data) * character
        slot = start
        while sent < len(data):
            slot = min(slot + burst, end)
            count = min(int((slot - start) / character + 1e-6), len(data))
            if slot == end:
                count = len(data)
            if count > sent:
                self._put(slot, data[sent:count])
                sent = count

    def _put(self, due: float, data: bytes) -> None:
        """Keep the queue in order: a late answer must not hold back those behind it."""
        waiting = self._waiting
        if not waiting or waiting[-1][0] <= due:
            waiting.append((due, data))
            return
        later = []
        while waiting and waiting[-1][0] > due:
            later.append(waiting.pop())
        waiting.append((due, data))
        waiting.extend(reversed(later))
