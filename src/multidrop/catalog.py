"""The profiles that ship with multidrop, and a user's own.

Found by name, in this order: the shipped ones, whose names nobody else can take;
the `profiles` folder of the plant file; the one in the user's configuration.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from multidrop.device import misleading
from multidrop.errors import UsageError
from multidrop.profile import Profile, nearest
from multidrop.protocols import PROTOCOLS
from multidrop.toml_values import read_toml

SHIPPED = Path(__file__).with_name("profiles")
CONFIG, CONFIG_ENVIRONMENT = "multidrop.toml", "MULTIDROP_CONFIG"
FOLDER = "profiles"
"""Beside the plant file, unless that names another with `profiles = "FOLDER"`."""


@dataclass(frozen=True, slots=True)
class OwnFile:
    """A profile of the user's own, and why it cannot be used by its name, if so."""

    path: Path
    problem: str = ""

    @property
    def name(self) -> str:
        return self.path.stem


def profile_names() -> list[str]:
    """Names of all shipped profiles; a protocol's own name is its profile with no points."""
    shipped = {entry.name.removesuffix(".toml") for entry in SHIPPED.glob("*.toml")}
    return sorted(shipped | set(PROTOCOLS))


def load_profile(name: str, config: Path | None = None) -> Profile:
    """The profile of this name, or of this file; `config` is the plant file.

    Raises `UsageError` with the nearest name.
    """
    if name.endswith(".toml"):
        return profile_file(Path(name))
    shipped = SHIPPED / f"{name}.toml"
    plain = "/" not in name and "\\" not in name
    if plain and shipped.is_file():
        return Profile.from_toml(shipped.read_text(encoding="utf-8"), f"{name}.toml")
    if name in PROTOCOLS:
        return Profile(name=name, protocol=name, title=f"any {name} device")
    places = folders(config)
    for folder in places if plain else ():
        path = folder / f"{name}.toml"
        if path.is_file():
            return _named(path)
    names = [*profile_names(), *(own.name for own in own_files(config) if not own.problem)]
    looked = f"; looked for {name}.toml in {' and '.join(map(str, places))}" if plain else ""
    raise UsageError(
        f"there is no profile {name!r}{nearest(name, names)}; profiles are {', '.join(names)}{looked}"
    )


def _named(path: Path) -> Profile:
    profile = profile_file(path)
    if profile.name != path.stem:
        raise UsageError(
            f"{path}: profile.name is {profile.name!r}, and the file is found as {path.stem!r}:"
            " give both one name"
        )
    return profile


def own_files(config: Path | None = None) -> Iterator[OwnFile]:
    """The user's own profiles, as they are found by name."""
    taken = dict.fromkeys(profile_names(), "a profile that multidrop ships")
    for folder in folders(config):
        for path in sorted(folder.glob("*.toml")):
            if path.stem in taken:
                yield OwnFile(path, f"the name is that of {taken[path.stem]}")
                continue
            taken[path.stem] = str(path)
            try:
                _named(path)
            except UsageError as error:
                yield OwnFile(path, str(error))
            else:
                yield OwnFile(path)


def folders(config: Path | None = None) -> list[Path]:
    """Where profiles are looked for that do not ship. Raises `UsageError` for a wrong `profiles` key."""
    import platformdirs

    plant = config or Path(os.environ.get(CONFIG_ENVIRONMENT, CONFIG))
    beside = [_folder_of(plant)] if plant.is_file() else []
    return [*beside, platformdirs.user_config_path("multidrop") / FOLDER]


def _folder_of(plant: Path) -> Path:
    try:
        found = read_toml(plant.read_text(encoding="utf-8"), str(plant)).get("profiles", FOLDER)
    except (
        OSError,
        UnicodeDecodeError,
        UsageError,
    ):  # whoever reads the plant says what is wrong with it
        found = FOLDER
    if not isinstance(found, str):
        raise UsageError(f"{plant}: profiles is {found!r}, which is no folder's name")
    return plant.parent / found


def profile_file(path: Path) -> Profile:
    """A user's own profile. Raises `UsageError` that names file, key and reason."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not UTF-8 text") from None
    profile = Profile.from_toml(text, str(path))
    if profile.protocol not in PROTOCOLS:
        raise UsageError(
            f"{path}: profile.protocol {profile.protocol!r}{nearest(profile.protocol, PROTOCOLS)}"
            f" is none of {', '.join(PROTOCOLS)}"
        )
    check_points(profile, str(path))
    return profile


def check_points(profile: Profile, file: str) -> None:
    """Can every point be said in its protocol? Raises `UsageError` that names file, point and reason."""
    where = f"{file}: profile"
    try:
        device = PROTOCOLS[profile.protocol].device(0, profile, {})
        for name in profile.points:
            where = f"{file}: points.{name}"
            device.points(name)
        for name in misleading(device, profile.points):
            where = f"{file}: points.{name}"
            raise UsageError(
                f"{name!r} is a place of its own in this protocol, and would be read and "
                "written instead: give the point another name"
            )
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from None
