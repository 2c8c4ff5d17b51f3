"""Read transactions over loopback TCP, master and slave in one asyncio loop: the rows."""

from __future__ import annotations

from statistics import median

from bench.measure import Result, line_of, ratio, start

NAMES = {
    "multidrop": "multidrop",
    "streams": "streams",
    "bare": "bare protocols",
    "bare_with_timeout": "bare protocols with a time-out pending",
    "rtu": "pymodbus RTU",
    "socket": "pymodbus TCP",
}
WORK = "read transactions over loopback TCP, one asyncio loop"
ROWS = {WORK: (), f"{WORK}, behind a connection that was opened and closed before": ("behind",)}
"""Work -> what a contestant is told. In the second the C library no longer gives memory back."""


def transactions(quick: bool) -> list[Result]:
    """Each contestant in a process of its own, one after the other, in several rounds."""
    return [_row(work, told, quick) for work, told in ROWS.items()]


def _row(work: str, told: tuple[str, ...], quick: bool) -> Result:
    """Compares with pymodbus' faster framer."""
    count = 1000 if quick else 3000
    rates: dict[str, list[float]] = {name: [] for name in NAMES}
    for _ in range(3 if quick else 9):
        for name, found in rates.items():
            process = start("contestants", name, str(count), *told)
            found.append(float(line_of(process.stdout)))
            process.communicate()
    ours = rates["multidrop"]
    faster = max(("rtu", "socket"), key=lambda name: median(rates[name]))
    to_pymodbus = ratio(ours, rates[faster])
    to_streams = ratio(ours, rates["streams"])
    figures = ", ".join(f"{NAMES[name]} {median(rates[name]):,.0f}" for name in rates)
    return Result(
        work,
        "pymodbus; asyncio streams as the limit",
        ">= 2.5 and >= 0.8",
        f"{to_pymodbus:.2f} and {to_streams:.2f}",
        to_pymodbus >= 2.5 and to_streams >= 0.8,
        [f"a second: {figures}"],
    )
