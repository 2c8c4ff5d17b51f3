"""A batch as bytes, for the outbox: JSON by columns, compressed. Pure."""

from __future__ import annotations

import json
import zlib
from typing import Any

from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.records import Batch, Row, Span


def pack(batch: Batch) -> bytes:
    """Names once each; times from the start of the span on."""
    names: dict[tuple[str, str], int] = {}
    series = [names.setdefault((row.device, row.point), len(names)) for row in batch.rows]
    span = batch.span
    facts = {
        "number": batch.number,
        "span": [span.run, span.number, span.start, span.shift, span.synchronised],
        "until": batch.until,
        "ended": batch.ended,
        "lost": [[gap.start, gap.end, gap.reason, gap.samples] for gap in batch.lost],
        "names": list(names),
        "series": series,
        "times": [row.time - span.start for row in batch.rows],
        "values": [row.value for row in batch.rows],
        "codes": [row.code for row in batch.rows],
    }
    return zlib.compress(json.dumps(facts, separators=(",", ":")).encode(), 1)


def unpack(data: bytes, lost: Gap | None = None) -> Batch:
    """The batch again; `lost` is what the outbox had to give up before it."""
    facts: dict[str, Any] = json.loads(zlib.decompress(data))
    span = Span(*facts["span"])
    names = facts["names"]
    rows = [
        Row(names[series][0], names[series][1], span.start + time, value, code)
        for series, time, value, code in zip(
            facts["series"], facts["times"], facts["values"], facts["codes"], strict=True
        )
    ]
    gaps = [Gap(*gap) for gap in facts["lost"]]
    if lost is not None:
        gaps.insert(0, lost)
    return Batch(facts["number"], span, facts["until"], facts["ended"], rows, tuple(gaps))
