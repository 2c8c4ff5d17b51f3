"""The serial ports of this machine: who has them open, and what slows or forbids them."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class PortFacts:
    """One serial port. `latency_ms` is a USB adapter's timer (FTDI: 16 as shipped, 1 is better)."""

    port: str  # a stable name where the system has one
    device: str
    adapter: str
    busy: str  # what has it open, "" for nothing that can be seen
    latency_ms: int | None
    problem: str  # why it cannot be opened, "" if it can

    def fields(self) -> dict[str, Any]:
        return asdict(self)


def list_ports() -> list[PortFacts]:
    """All serial ports that the system knows, by name."""
    import serialx

    open_by = _open_files()
    found = []
    for info in serialx.list_serial_ports():
        device = info.resolved_device or info.device
        found.append(
            PortFacts(
                port=info.device,
                device=device,
                adapter=" ".join(filter(None, (info.manufacturer, info.product))) or "built in",
                busy=open_by.get(os.path.realpath(device), ""),
                latency_ms=latency_of(device),
                problem=_problem(device),
            )
        )
    return sorted(found, key=lambda facts: facts.port)


def latency_of(device: str) -> int | None:
    """ms that the timer of a USB adapter is set to; None where there is none (Linux)."""
    try:
        text = Path(
            f"/sys/class/tty/{Path(os.path.realpath(device)).name}/device/latency_timer"
        ).read_text()
        return int(text)
    except (OSError, ValueError):
        return None


def _problem(device: str) -> str:
    if os.name != "posix" or os.access(device, os.R_OK | os.W_OK):
        return ""
    try:
        import grp

        group = grp.getgrgid(os.stat(device).st_gid).gr_name
    except (OSError, KeyError):
        return "no permission"
    return f"no permission: add yourself to group {group}"


def _open_files(proc: Path = Path("/proc")) -> dict[str, str]:
    """Device path -> program that has it open, as far as this user may see (Linux)."""
    found: dict[str, str] = {}
    for process in proc.glob("[0-9]*"):
        try:
            name = (process / "comm").read_text().strip()
            for link in (process / "fd").iterdir():
                target = os.readlink(link)
                if target.startswith("/dev/"):
                    found[target] = f"{name} ({process.name})"
        except OSError:
            continue
    return found
