"""What a scan has found, where it is, and the file that keeps both until it is finished."""

from __future__ import annotations

import contextlib
import json
import os
import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from multidrop.errors import UsageError
from multidrop.tools.scan.plan import Wanted
from multidrop.tools.scan.sweep import Found


@dataclass(frozen=True, slots=True)
class FoundDevice:
    """A device of the result. `profile` is None, and `error` says why, where only damage came."""

    protocol: str
    profile: str | None
    address: int
    baud: int
    format: str
    ms: float | None = None
    behind: str | None = None
    note: str = ""
    error: str = ""


@dataclass(frozen=True, slots=True)
class Traffic:
    """Somebody speaks on this line: what was heard, before or between our probes."""

    baud: int
    format: str
    protocol: str | None = None
    size: int = 0  # bytes
    seconds: float = 0.0
    lines: tuple[str, ...] = ()
    addresses: tuple[int, ...] = ()
    between: bool = False  # while probes were being sent


@dataclass(slots=True)
class State:
    """Where a scan is: as much as is needed to go on with it."""

    wanted: Wanted
    number: int = 0  # of the round
    left: list[int] | None = None  # addresses of that round; None: all
    found: dict[int, Found] = field(default_factory=dict)  # in that round, not identified yet
    devices: list[FoundDevice] = field(default_factory=list)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> State:
        """Raises `TypeError`, `KeyError`, `ValueError` or `AttributeError` where it is no state."""
        wanted: dict[str, Any] = {
            key: tuple(item) if isinstance(item, list) else item
            for key, item in data["wanted"].items()
        }
        return cls(
            wanted=Wanted(**wanted),
            number=int(data["number"]),
            left=None if data["left"] is None else [int(item) for item in data["left"]],
            found={int(address): Found(**item) for address, item in data["found"].items()},
            devices=[FoundDevice(**item) for item in data["devices"]],
        )


class StateFile:
    """Keeps the state of one port's scan, so that it can be gone on with after Ctrl-C."""

    EVERY = 1.0  # s

    def __init__(self, port: str, path: Path | None = None) -> None:
        self.path = path or default_path(port)
        self.named = path is not None
        self._port = port
        self._kept_at = float("-inf")

    def load(self) -> State | None:
        """What an earlier scan left behind. Raises `UsageError` where it cannot be read."""
        try:
            data = json.loads(self.path.read_text(encoding="utf-8"))
            if data["port"] != self._port:
                raise UsageError(f"{self.path} is of a scan of {data['port']}, not {self._port}")
            return State.from_json(data["state"])
        except FileNotFoundError:
            return None
        except OSError as error:
            raise UsageError(f"{self.path}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError, AttributeError):
            raise UsageError(
                f"{self.path} holds no scan; without --resume it begins anew"
            ) from None

    def keep(self, state: State, now: float | None = None) -> None:
        """Write it down; with `now` (s) at most once a second. Raises `OSError`."""
        if now is not None and now < self._kept_at + self.EVERY:
            return
        if now is not None:
            self._kept_at = now
        self.path.parent.mkdir(parents=True, exist_ok=True)
        new = self.path.with_name(self.path.name + ".new")
        text = json.dumps({"v": 1, "port": self._port, "state": asdict(state)})
        new.write_text(text, encoding="utf-8")
        os.replace(new, self.path)

    def remove(self) -> None:
        """The scan is over. A file that stays is begun anew the next time, and said so."""
        with contextlib.suppress(OSError):
            self.path.unlink()


def default_path(port: str) -> Path:
    """`scan/PORT.json` in the user's state folder."""
    from platformdirs import user_state_path

    name = re.sub(r"[^\w.-]+", "_", port).strip("_")
    return user_state_path("multidrop", appauthor=False) / "scan" / f"{name}.json"


def as_toml(port: str, devices: list[FoundDevice]) -> str:
    """A `multidrop.toml` of what was found.

    A line has one setting and one protocol. Where devices were found at several,
    the setting with most of them is the line, and the others stand there as comments.
    """
    by_setting: dict[tuple[str, int, str], list[FoundDevice]] = {}
    for device in devices:
        if device.profile is not None:
            key = (device.protocol, device.baud, device.format)
            by_setting.setdefault(key, []).append(device)
    groups = sorted(by_setting.items(), key=lambda item: -len(item[1]))
    parts = []
    for number, ((protocol, baud, form), members) in enumerate(groups):
        lines = ["[line.bus]", f"port = {json.dumps(port)}", f"baud = {baud}", f'format = "{form}"']
        for device in members:
            lines += ["", *_device_table(device)]
        if number:
            head = f"# At another setting, {protocol} {baud} {form}; a line has only one:"
            lines = [head, *(f"# {line}".rstrip() for line in lines)]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _device_table(device: FoundDevice) -> list[str]:
    lines = [f"[line.bus.device.{device.profile}_{device.address}]"]
    if device.note:
        note = "".join(char if char.isprintable() else "?" for char in device.note)
        lines.append(f"# {note}")
    lines += [f'profile = "{device.profile}"', f"address = {device.address}"]
    if device.behind:
        lines.append(f'behind = "{device.behind}"')
    return lines
