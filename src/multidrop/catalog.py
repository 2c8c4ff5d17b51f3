"""The profiles that ship with multidrop, and a user's own."""

from __future__ import annotations

from pathlib import Path

from multidrop.errors import UsageError
from multidrop.profile import Profile, nearest
from multidrop.protocols import PROTOCOLS

SHIPPED = Path(__file__).with_name("profiles")


def profile_names() -> list[str]:
    """Names of all shipped profiles; a protocol's own name is its profile with no points."""
    shipped = {entry.name.removesuffix(".toml") for entry in SHIPPED.glob("*.toml")}
    return sorted(shipped | set(PROTOCOLS))


def load_profile(name: str) -> Profile:
    """The profile of this name, or of this file. Raises `UsageError` with the nearest name."""
    if name.endswith(".toml"):
        return profile_file(Path(name))
    shipped = SHIPPED / f"{name}.toml"
    if "/" not in name and "\\" not in name and shipped.is_file():
        return Profile.from_toml(shipped.read_text(encoding="utf-8"), f"{name}.toml")
    if name in PROTOCOLS:
        return Profile(name=name, protocol=name, title=f"any {name} device")
    names = profile_names()
    raise UsageError(
        f"there is no profile {name!r}{nearest(name, names)}; profiles are {', '.join(names)}"
    )


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
    return profile
