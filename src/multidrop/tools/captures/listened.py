"""A line that is only listened to: which protocol it has, and who is on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from multidrop.catalog import load_profile
from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.io.captured import Interface
from multidrop.observer import Observer
from multidrop.profile import Profile
from multidrop.timing import LineSettings


@dataclass(frozen=True, slots=True)
class Listened:
    """A line, its settings, and the devices of it that are known, by their addresses."""

    port: str
    protocol: ProtocolModule
    settings: LineSettings
    profiles: Mapping[int, Profile] = field(default_factory=dict)
    names: Mapping[int, str] = field(default_factory=dict)
    own: Mapping[str, str] = field(default_factory=dict)  # keys of the protocol's own

    def observer(self, *, network: bool = False) -> Observer:
        """Follows it. Raises `UsageError` for a profile of another protocol."""
        return Observer(self.protocol, self.settings, self.profiles, network=network)

    def device(self, address: int) -> str:
        """`PROFILE:ADDRESS@PORT`, as the command line names it."""
        return f"{self._who(address)}@{self.port}"

    def label(self, address: int) -> str:
        """Its name in the plant file, or `PROFILE:ADDRESS`."""
        return self.names.get(address) or self._who(address)

    def _who(self, address: int) -> str:
        profile = self.profiles.get(address)
        return f"{profile.name if profile else self.protocol.name}:{address}"


def of_interface(
    interface: Interface,
    protocol: ProtocolModule,
    profiles: Mapping[int, Profile],
    names: Mapping[int, str],
) -> tuple[Listened, list[str]]:
    """The line of a capture; `profiles` and `names` go before what the capture says.

    Also what of the capture's devices is not known here, for a warning.
    """
    unknown = []
    known: dict[int, Profile] = {}
    called: dict[int, str] = {}
    for address, device in interface.devices.items():
        called[address] = device.name
        try:
            profile = load_profile(device.profile)
        except UsageError as error:
            if address not in profiles:
                unknown.append(f"device {address}: {error}")
            continue
        if profile.protocol == protocol.name:
            known[address] = profile
    line = Listened(
        interface.name,
        protocol,
        interface.settings(protocol),
        {**known, **profiles},
        {**called, **names},
        interface.own,
    )
    return line, unknown
