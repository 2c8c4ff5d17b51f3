"""What a line says that a doctor only listens to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from multidrop.observer import Observer
from multidrop.tools.doctor.answered import MOST_PROOF, TERMINATION, WIRING
from multidrop.tools.doctor.evidence import GLITCH, Arrived, Evidence, Examined, examine
from multidrop.tools.doctor.verdicts import Sure, Verdict, What
from multidrop.transaction import Heard, Transaction

ACKNOWLEDGE = 0.050
"""s from an echo to its Acknowledge that are long: half of what an instrument allows."""
AT_ONCE = 0.005
"""s after a question within which no master asks another one."""
MARKED = 0.25
"""Share of the right bytes that a port marks as wrong, above which the format is."""


def other_format(found: Examined) -> bool:
    """Whether the port marks so many right bytes as wrong that only their parity can be."""
    whole = sum(len(item.raw) for item in found.frames)
    return sum(item.marked for item in found.frames) > MARKED * whole


def judge_traffic(evidence: Evidence, *, expected: bool) -> list[Verdict]:
    """The verdicts of a line that others speak on; `expected` is for one who only wanted to listen."""
    found = examine(evidence.heard, evidence.protocol, evidence.settings)
    if found.size <= GLITCH:
        return []
    observer = Observer(evidence.protocol, evidence.settings, {}, network=evidence.network)
    heard = [
        item
        for piece in evidence.heard
        for item in observer.receive_data(piece.data, piece.now, damaged=piece.damaged)
    ]
    transactions = [item for item in (*heard, *observer.finish()) if isinstance(item, Transaction)]
    traffic = _Traffic(evidence, found, transactions)
    return [
        *traffic.other_master(expected),
        *traffic.two_masters(),
        *traffic.damage(),
        *traffic.gaps(),
        *traffic.late(),
        *traffic.unanswered(),
        *traffic.acknowledges(),
    ]


@dataclass(frozen=True, slots=True)
class _Traffic:
    evidence: Evidence
    found: Examined
    transactions: list[Transaction]

    def _shown(self, item: Arrived | Heard) -> str:
        protocol = self.evidence.protocol
        return f"{protocol.shown(item.raw)}  | {protocol.describe(item.frame)}"

    def _masters(self) -> list[Arrived]:
        return [
            item for item in self.found.frames if self.evidence.protocol.from_master(item.frame)
        ]

    def other_master(self, expected: bool) -> Iterator[Verdict]:
        evidence, masters = self.evidence, self._masters()
        if not masters:
            return
        devices = sorted({item.address for item in self.transactions if item.answer_ms is not None})
        who = f"; answers come from {', '.join(map(str, devices))}" if devices else ""
        yield Verdict(
            What.SOMEBODY if expected else What.SECOND_MASTER,
            Sure.CERTAIN,
            f"a master speaks {evidence.setting}: {len(masters)} requests in {evidence.seconds:.0f} s{who}"
            + ("" if expected else "; so nothing was sent"),
            tuple(self._shown(item) for item in self.found.frames[:MOST_PROOF]),
            ()
            if expected
            else (
                "two masters on one line disturb each other: stop this one before you ask",
                "to judge its traffic: --listen-only, for longer with --seconds 60",
            ),
        )

    def two_masters(self) -> Iterator[Verdict]:
        """A question, and another one before anybody can have answered."""
        protocol = self.evidence.protocol
        hasty = [
            (one, other)
            for one, other in zip(self.found.frames, self.found.frames[1:], strict=False)
            if protocol.from_master(one.frame)
            and protocol.from_master(other.frame)
            and one.frame != other.frame
            and not protocol.continues((one.frame,), other.frame)
            and other.start - one.end < AT_ONCE
        ]
        if len(hasty) > 1:
            one, other = hasty[0]
            yield Verdict(
                What.COLLISIONS,
                Sure.LIKELY,
                f"{len(hasty)} questions came before the one before could be answered: two masters?",
                (
                    self._shown(one),
                    f"{self._shown(other)}  ({(other.start - one.end) * 1000:.1f} ms later)",
                ),
                ("find out which two programs or panels speak here, and stop one of them",),
            )

    def damage(self) -> Iterator[Verdict]:
        found = self.found
        if other_format(found):
            yield Verdict(
                What.SETTINGS,
                Sure.CERTAIN,
                "the bytes are right and their parity is not: the line has another format than "
                f"{self.evidence.settings.format}",
                (f"{found.marked} of {found.size} bytes came with a parity or framing error",),
                ("give its format, as in format=8N1 (or 8O1, 8E1)",),
            )
        elif found.marked:
            yield Verdict(
                What.PARITY,
                Sure.CERTAIN,
                f"{found.marked} of {found.size} bytes came with a parity or framing error "
                f"({found.marked / found.size:.1%})",
                self._broken(),
                ("every byte: another format; a few: a bad line", TERMINATION),
            )
        yield from self._spoiled()

    def _spoiled(self) -> Iterator[Verdict]:
        """Bytes that are no frame, and whom they followed."""
        masters = self._masters()
        asked, spoiled = Counter(item.frame.address for item in masters), Counter[int]()
        for item in self.found.broken:
            before = [master for master in masters if master.start < item.start]
            if before:
                spoiled[before[-1].frame.address] += 1
        if spoiled:
            rates = tuple(
                f"after questions to {address}: {count} of {asked[address]} damaged "
                f"({count / asked[address]:.0%})"
                for address, count in sorted(spoiled.items())
            )
            yield Verdict(
                What.CHECKSUMS,
                Sure.CERTAIN,
                f"some bytes are no frame: {'; '.join(rates[:3])}",
                (*rates, *self._broken()),
                (TERMINATION, WIRING),
            )

    def _broken(self) -> tuple[str, ...]:
        """The first of the damage, as proof."""
        return tuple(
            f"{self.evidence.protocol.shown(item.raw[:32])}  | {item.reason}"
            for item in self.found.broken[:MOST_PROOF]
        )

    def gaps(self) -> Iterator[Verdict]:
        evidence = self.evidence
        limit = evidence.settings.timing(network=evidence.network).silence
        items = [item for item in self.found.frames if item.gap > limit]
        if items:
            yield Verdict(
                What.GAPS,
                Sure.CERTAIN,
                f"{len(items)} frames have pauses in them, up to "
                f"{max(item.gap for item in items) * 1000:.0f} ms; a frame ends after {limit * 1000:.0f} ms",
                tuple(
                    f"{self._shown(item)}: came in {' + '.join(map(str, item.pieces))} bytes"
                    for item in items[:MOST_PROOF]
                ),
                ("whoever sends them is too slow, or the adapter holds bytes back",),
            )

    def late(self) -> Iterator[Verdict]:
        evidence = self.evidence
        limit = evidence.settings.timing(network=evidence.network).answer * 1000
        for address in sorted({item.address for item in self.transactions}):
            late = [
                item
                for item in self.transactions
                if item.address == address and item.answer_ms is not None and item.answer_ms > limit
            ]
            if late:
                yield Verdict(
                    What.LATE,
                    Sure.CERTAIN,
                    f"address {address} answered {len(late)} times after more than {limit:.0f} ms",
                    tuple(
                        f"{self._shown(item.frames[0])}: answered after {item.answer_ms:.0f} ms"
                        for item in late[:MOST_PROOF]
                    ),
                    ("whoever asks has to wait longer",),
                )

    def unanswered(self) -> Iterator[Verdict]:
        asked, lost = Counter[int](), Counter[int]()
        heard = self.transactions
        if heard and _unanswered(heard[-1]):
            heard = heard[:-1]  # its answer may have come when nobody listened any more
        for item in heard:
            asked[item.address] += 1
            lost[item.address] += _unanswered(item)
        for address, count in sorted(lost.items()):
            if count:
                yield Verdict(
                    What.SILENT,
                    Sure.CERTAIN,
                    f"address {address} left {count} of {asked[address]} questions unanswered",
                    tuple(
                        self._shown(item.frames[0])
                        for item in self.transactions
                        if item.address == address and _unanswered(item)
                    )[:2],
                    ("is the device on, and has it this address?",)
                    if count == asked[address]
                    else ("a loose wire, a busy device, or questions that reach it damaged",),
                )

    def acknowledges(self) -> Iterator[Verdict]:
        """A change, its echo, and when its master said yes."""
        protocol = self.evidence.protocol
        delays = [
            (third.start - second.end, item)
            for item in self.transactions
            for second, third in zip(item.frames[1:], item.frames[2:], strict=False)
            if protocol.from_master(third.frame) and not protocol.from_master(second.frame)
        ]
        slow = [(delay, item) for delay, item in delays if delay > ACKNOWLEDGE]
        if slow:
            longest, item = max(slow, key=lambda pair: pair[0])
            yield Verdict(
                What.ACKNOWLEDGE,
                Sure.CERTAIN,
                f"{len(slow)} of {len(delays)} changes were acknowledged late, up to "
                f"{longest * 1000:.0f} ms after their echo; an instrument drops them after 100 ms",
                tuple(self._shown(heard) for heard in item.frames),
                (
                    "the master is slow, or its adapter: set its latency timer to 1 ms",
                    "look whether the changes were made: nothing answers an Acknowledge",
                ),
            )


def _unanswered(item: Transaction) -> bool:
    return len(item.frames) == 1 and not item.meaning.complete
