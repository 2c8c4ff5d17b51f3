"""The tables of `multidrop.toml` beside the lines: `[http] [history] [mqtt] [modbus] [faults] [passports]`.

A part of the gateway is on where its table stands in the file. Each table is a
dataclass here; each field is a key, with its meaning, for docs/reference/configuration.md.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

from multidrop.errors import UsageError
from multidrop.plant import Plant
from multidrop.profile import nearest

TableT = TypeVar("TableT")


def entry(meaning: str, default: Any = MISSING, *, least: float | None = None) -> Any:
    """A key of a table; without a default it must be given. Numbers are `least` or more."""
    return field(default=default, metadata={"meaning": meaning, "least": least})


@dataclass(frozen=True, slots=True)
class HttpSettings:
    """`[http]`: the page, the JSON interface, metrics."""

    listen: str = entry("HOST:PORT where it listens", "127.0.0.1:8080")
    tokens: str | None = entry("file of the tokens that give the right to read or to write", None)
    certificate: str | None = entry("file of the TLS certificate, PEM", None)
    key: str | None = entry("file of the certificate's private key, PEM", None)
    names: tuple[str, ...] = entry("further host names by which browsers may call it", ())


@dataclass(frozen=True, slots=True)
class HistorySettings:
    """`[history]`: what was, for charts."""

    path: str = entry("the SQLite file", "history.db")
    dsn: str | None = entry("PostgreSQL instead: postgresql://USER@HOST/DATABASE", None)
    keep: float = entry("days that values are kept; 0: for ever", 400.0, least=0.0)
    longest: float = entry("s after which an unchanged value is recorded again", 600.0, least=1.0)
    outbox: str = entry(
        "file of what waits for a PostgreSQL server that is away", "history-outbox.db"
    )
    outbox_size: float = entry("MB that may wait there; the oldest go first", 1000.0, least=1.0)


@dataclass(frozen=True, slots=True)
class MqttSettings:
    """`[mqtt]`: values to an MQTT 5 broker, commands from it."""

    host: str = entry("the broker")
    port: int = entry("its TCP port", 1883, least=1)
    user: str | None = entry("user name", None)
    password: str | None = entry("file whose first line is the password", None)
    tls: bool = entry("encrypted, with a certificate that is checked", False)
    authority: str | None = entry("file of the authority of the broker's certificate, PEM", None)
    topic: str = entry("first part of all topics", "multidrop")
    discovery: str | None = entry("prefix of Home Assistant's discovery, as in homeassistant", None)
    longest: float = entry("s after which an unchanged state is sent again", 60.0, least=1.0)
    commands: bool = entry("whether points may be written by MQTT", False)
    outbox: str | None = entry(
        "file of what waits for a broker that is away; without it only the newest states do", None
    )
    outbox_size: float = entry("MB that may wait there; the oldest go first", 100.0, least=1.0)


@dataclass(frozen=True, slots=True)
class ModbusSettings:
    """`[modbus]`: a Modbus TCP server."""

    listen: str = entry("HOST:PORT where it listens", "127.0.0.1:5020")
    writes: bool = entry("whether points may be written by Modbus", False)
    map: str = entry("file of the register map; what stands there is never moved", "registers.csv")


@dataclass(frozen=True, slots=True)
class FaultSettings:
    """`[faults]`: what is kept when a device trips."""

    path: str = entry("folder of the freeze-frames", "faults")
    seconds: float = entry("s of polled values before the fault that are kept", 10.0, least=0.0)
    frames: int = entry("frames of the line before the fault that are kept", 200, least=0)
    keep: int = entry("freeze-frames that are kept of each device", 100, least=1)


@dataclass(frozen=True, slots=True)
class PassportSettings:
    """`[passports]`: backups of devices, and what they differ in."""

    path: str = entry("folder of the passports, which watch-drift looks into too", "passports")
    most: int = entry(
        "passports of each device from which on the page makes no more; none is ever deleted",
        200,
        least=1,
    )


@dataclass(frozen=True, slots=True)
class Settings:
    """All of them; None where a table does not stand in the file: that part is off.

    Relative paths are relative to `folder`, the one of the plant file.
    """

    folder: Path = Path()
    http: HttpSettings | None = None
    history: HistorySettings | None = None
    mqtt: MqttSettings | None = None
    modbus: ModbusSettings | None = None
    faults: FaultSettings | None = None
    passports: PassportSettings | None = None
    wrong: tuple[str, ...] = ()

    def path(self, text: str) -> Path:
        """A path as a table gives it."""
        return self.folder / Path(text).expanduser()


def objections(*attempts: Callable[[], object]) -> Iterator[str]:
    """What all these raise as `UsageError`: one thing that is wrong must not hide another."""
    for attempt in attempts:
        try:
            attempt()
        except UsageError as error:
            yield str(error)


def demand_writable(key: str, path: Path, *, folder: bool = False) -> None:
    """Raises `UsageError` where `key` names a file (or a folder) that cannot be written or made."""
    if path.exists():
        if path.is_dir() is not folder:
            kind = "is no folder" if folder else "is a folder"
            raise UsageError(f"{key} {path}: it {kind}")
        if not os.access(path, os.W_OK):
            raise UsageError(f"{key} {path}: it cannot be written")
        return
    above = path.parent
    while folder and not above.exists():
        above = above.parent
    if not above.is_dir():
        raise UsageError(f"{key} {path}: there is no folder {above}")
    if not os.access(above, os.W_OK):
        raise UsageError(f"{key} {path}: it cannot be made, for {above} cannot be written")


CLASSES: Mapping[str, type] = {
    "http": HttpSettings,
    "history": HistorySettings,
    "mqtt": MqttSettings,
    "modbus": ModbusSettings,
    "faults": FaultSettings,
    "passports": PassportSettings,
}


def settings_of(plant: Plant) -> Settings:
    """The tables of a plant file. Raises `UsageError` with all that is wrong."""
    settings = survey_settings(plant)
    if settings.wrong:
        raise UsageError("\n".join(settings.wrong))
    return settings


def passports_folder(plant: Plant) -> Path:
    """Where the passports of a plant are, whether its gateway makes some or not. Raises `UsageError`."""
    wrong: list[str] = []
    table = plant.tables.get("passports", {})
    found = read_table(PassportSettings, table, f"{plant.file}: passports", wrong)
    if wrong or found is None:
        raise UsageError("\n".join(wrong))
    return Settings(Path(plant.file).parent).path(found.path)


def survey_settings(plant: Plant) -> Settings:
    """The same with what is `wrong`; a table that is wrong is off."""
    wrong: list[str] = []
    tables: dict[str, Any] = {}
    for name, table in plant.tables.items():
        before = len(wrong)
        found = read_table(CLASSES[name], table, f"{plant.file}: {name}", wrong)
        if len(wrong) == before:
            tables[name] = found
    return Settings(Path(plant.file).parent, wrong=tuple(wrong), **tables)


def read_table(
    table_class: type[TableT], table: Any, where: str, wrong: list[str]
) -> TableT | None:
    """One table; what is wrong is added to `wrong`, and None comes where nothing can be made of it."""
    if not isinstance(table, dict):
        wrong.append(f"{where} is not a table")
        return None
    known: dict[str, Field[Any]] = {item.name: item for item in fields(table_class)}  # type: ignore[arg-type]
    given: dict[str, Any] = {}
    missing = False
    for name, value in table.items():
        if name not in known:
            wrong.append(f"{where}: unknown key {name!r}{nearest(name, known)}")
            continue
        reason = _refused(value, known[name])
        if reason:
            wrong.append(f"{where}.{name} is {value!r}, which is not {reason}")
        given[name] = tuple(value) if isinstance(value, list) else value
    for name, item in known.items():
        if item.default is MISSING and name not in table:
            wrong.append(f"{where}.{name} is missing: {item.metadata['meaning']}")
            missing = True
    return None if missing else table_class(**given)


_TYPES: dict[str, tuple[type | tuple[type, ...], str]] = {
    "str": (str, "a text"),
    "str | None": (str, "a text"),
    "int": (int, "a whole number"),
    "float": ((int, float), "a number"),
    "bool": (bool, "true or false"),
    "tuple[str, ...]": (list, "a list of texts"),
}


def _refused(value: Any, item: Field[Any]) -> str:
    """What a value should have been; empty where it is right."""
    expected, name = _TYPES[str(item.type)]
    if not isinstance(value, expected) or (isinstance(value, bool) and expected is not bool):
        return name
    if isinstance(value, list) and not all(isinstance(text, str) for text in value):
        return name
    least = item.metadata["least"]
    if least is not None and not value >= least:
        return f"{name} of {least:g} or more"
    return ""
