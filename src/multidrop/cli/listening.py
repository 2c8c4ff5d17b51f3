"""What `sniff` and `decode` share: who is on a line, what is wanted of it, how it is shown."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import click

from multidrop.catalog import CONFIG, CONFIG_ENVIRONMENT, load_profile
from multidrop.cli import flags
from multidrop.cli.options import CommandT
from multidrop.errors import UsageError
from multidrop.numerals import is_digits
from multidrop.plantfile import Plant, load_plant
from multidrop.profile import Profile, nearest
from multidrop.protocols import PROTOCOLS
from multidrop.tools.captures.records import KINDS, Filter


@dataclass(frozen=True, slots=True)
class Company:
    """The devices that are known to be on a line, and the keys that the plant file has for it."""

    profiles: Mapping[int, Profile] = field(default_factory=dict)
    names: Mapping[int, str] = field(default_factory=dict)
    keys: Mapping[str, str] = field(default_factory=dict)

    def protocol(self) -> str | None:
        """The one protocol of them all. Raises `UsageError` where there are two."""
        found = {profile.protocol for profile in self.profiles.values()}
        if len(found) > 1:
            raise UsageError(f"one line has one protocol, these have {' and '.join(sorted(found))}")
        return found.pop() if found else None


def find_plant(config: str | None) -> Plant | None:
    """The plant file that was named, or the one that is here. Raises `UsageError`."""
    path = Path(config or os.environ.get(CONFIG_ENVIRONMENT, CONFIG))
    if config is None and not path.exists():
        return None
    return load_plant(path, functools.partial(load_profile, config=path))


def company(plant: Plant | None, port: str, device_profiles: tuple[str, ...]) -> Company:
    """Who is on a port: by the plant file, and by `ADDRESS=PROFILE` over it. Raises `UsageError`."""
    profiles: dict[int, Profile] = {}
    names: dict[int, str] = {}
    keys: dict[str, str] = {}
    for device in plant.devices.values() if plant is not None else ():
        address = device.device.address
        if device.device.port == port and address is not None:
            profiles[address], names[address] = device.profile, device.name
            keys.update(device.device.options)
    for text in device_profiles:
        address_text, equals, profile = text.partition("=")
        if not equals or not is_digits(address_text) or not profile:
            raise UsageError(f"{text!r} is not ADDRESS=PROFILE, as in 2=ax-v")
        profiles[int(address_text)] = load_profile(profile)
    return Company(profiles, names, keys)


def protocol_name(name: str | None) -> str | None:
    """Raises `UsageError` for what is no protocol."""
    if name is not None and name not in PROTOCOLS:
        raise UsageError(
            f"there is no protocol {name!r}{nearest(name, PROTOCOLS)}; protocols are {', '.join(PROTOCOLS)}"
        )
    return name


@dataclass(frozen=True, slots=True)
class Listening:
    """The options that `sniff` and `decode` share, as given."""

    json: bool
    csv: bool
    protocol: str | None
    device_profiles: tuple[str, ...]
    device: tuple[str, ...]
    point: tuple[str, ...]
    kind: tuple[str, ...]
    config: str | None

    @property
    def style(self) -> str:
        """Raises `UsageError` for two at once."""
        if self.json and self.csv:
            raise UsageError("--json or --csv: one of them")
        return "json" if self.json else "csv" if self.csv else "text"

    @property
    def wanted(self) -> Filter:
        """Raises `UsageError` for what is no kind."""
        for name in self.kind:
            if name not in KINDS:
                raise UsageError(
                    f"there is no kind {name!r}{nearest(name, KINDS)}; kinds are {' '.join(KINDS)}"
                )
        return Filter(self.device, self.point, self.kind)


def listening(command: CommandT) -> CommandT:
    """Gives a command these options, and with them `asked: Listening`."""

    @functools.wraps(command)
    def wrapper(**given: Any) -> Any:
        own = {field.name: given.pop(field.name) for field in fields(Listening)}
        return command(asked=Listening(**own), **given)

    add: list[Callable[[Any], Any]] = [
        flags.as_json,
        click.option("--csv", is_flag=True, help="CSV on standard output"),
        click.option("--protocol", metavar="P", help="slink3, datalink or ultra3000"),
        click.option(
            *("--device-profile", "device_profiles"),
            multiple=True,
            metavar="ADDRESS=PROFILE",
            help="the model of a device: names and types of its points",
        ),
        click.option(
            "--device",
            multiple=True,
            metavar="NAME",
            help="only this one: address, name or PROFILE:ADDRESS; * matches",
        ),
        click.option(
            "--point",
            multiple=True,
            metavar="NAME",
            help="only this one: name or number; * matches",
        ),
        click.option("--kind", multiple=True, metavar="KIND", help=f"only {' '.join(KINDS)}"),
        flags.config,
    ]
    decorated: Any = wrapper
    for option in reversed(add):
        decorated = option(decorated)
    return decorated  # type: ignore[no-any-return]
