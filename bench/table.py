"""The table: which rows there are, on which machine, and what became of the goals."""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench import backup, datalink, gateway, gateway_lines, history, service, ultra3000
from bench.codec import decoding, encoding
from bench.decode import decoding_captures
from bench.many_lines import many_lines
from bench.measure import ROOT, Result
from bench.memory import memory
from bench.paced import paced
from bench.scan import scan
from bench.share import share
from bench.startup import startup
from bench.transactions import transactions

ROWS: dict[str, Callable[[bool], list[Result]]] = {
    "decoding": decoding,
    "encoding": encoding,
    "captures": decoding_captures,
    "transactions": transactions,
    "paced": paced,
    "lines": many_lines,
    "share": share,
    "service": service.rows,
    "history": history.rows,
    "history_large": history.large,
    "gateway": gateway.rows,
    "gateway_lines": gateway_lines.rows,
    "gateway_minutes": gateway.memory,
    "scan": scan,
    "backup": backup.rows,
    "startup": startup,
    "memory": memory,
    "datalink": datalink.rows,
    "ultra3000": ultra3000.rows,
}
LONG = ("history_large", "gateway_minutes")
"""Only where they are named."""

README = ROOT / "bench" / "README.md"
MEASURED = ROOT / "bench" / "measured.json"
BEGIN, END = "<!-- measured: begin -->\n", "<!-- measured: end -->\n"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="bench", description="Measures multidrop against its peers."
    )
    parser.add_argument(
        "rows",
        nargs="*",
        metavar="ROW",
        help=f"which of {' '.join(ROWS)}; all but {' '.join(LONG)}",
    )
    parser.add_argument("--quick", action="store_true", help="fewer and shorter rounds")
    parser.add_argument("--write", action="store_true", help="keep the table in bench/README.md")
    chosen = parser.parse_args()
    for row in chosen.rows:
        if row not in ROWS:
            parser.error(f"there is no row {row!r}; rows are {' '.join(ROWS)}")
    known = measured() if chosen.write else {}
    for row in chosen.rows or [row for row in ROWS if row not in LONG]:
        print(f"measuring {row} ...", flush=True)
        where = machine()
        results = ROWS[row](chosen.quick)
        print(f"\n{where}\n\n{table(results)}\n\n{beside(results)}\n", flush=True)
        known[row] = {"where": where, "results": [asdict(result) for result in results]}
        if chosen.write:
            keep(known)
    return 0


def measured() -> dict[str, Any]:
    """What was measured before: row -> where and when, and its results."""
    if not MEASURED.exists():
        return {}
    found: dict[str, Any] = json.loads(MEASURED.read_text())
    return {row: found[row] for row in ROWS if row in found}


def keep(known: dict[str, Any]) -> None:
    """Keep all that is known, and show it in the README."""
    known = {row: known[row] for row in ROWS if row in known}
    MEASURED.write_text(json.dumps(known, indent=1, ensure_ascii=False) + "\n")
    places = dict.fromkeys(entry["where"].partition("; load")[0] for entry in known.values())
    results = [Result(**result) for entry in known.values() for result in entry["results"]]
    loads = [
        f"{row} {entry['where'].partition('load before the run ')[2].rstrip('.')}"
        for row, entry in known.items()
    ]
    text = "\n\n".join(
        [
            *places,
            table(results),
            f"Load before each row's run: {'; '.join(loads)}.",
            beside(results),
        ]
    )
    head, _, rest = README.read_text().partition(BEGIN)
    README.write_text(f"{head}{BEGIN}\n{text}\n\n{END}{rest.partition(END)[2]}")


def table(results: list[Result]) -> str:
    """Markdown that also reads well in a terminal."""
    heads = ("work", "against", "goal", "measured", "")
    rows = [heads] + [
        (result.work, result.against, result.goal, result.measured, _verdict(result))
        for result in results
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(heads))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def _verdict(result: Result) -> str:
    return "met" if result.met else "NOT MET"


def beside(results: list[Result]) -> str:
    """What was measured with it and has no goal."""
    lines = []
    for result in results:
        lines.append(f"- {result.work}")
        lines += [f"  - {text}" for text in result.beside]
    return "\n".join(lines)


def machine() -> str:
    """Where and when, in one line."""
    libraries = ", ".join(
        f"{name} {version(name)}" for name in ("multidrop", "pymodbus", "click", "serialx")
    )
    return (
        f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.release()}; "
        f"{platform.python_implementation()} {platform.python_version()}; {libraries}; "
        f"{datetime.now(UTC):%Y-%m-%d}; load before the run {os.getloadavg()[0]:.1f}, nice {os.nice(0)}."
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
