"""The protocols, pure and strangers to each other. A new one is a folder and a line in `PROTOCOLS`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from multidrop.device import ProtocolModule

_WHERE = {
    "slink3": ("multidrop.protocols.slink3.protocol", "Slink3"),
    "datalink": ("multidrop.protocols.datalink.protocol", "Datalink"),
    "ultra3000": ("multidrop.protocols.ultra3000.protocol", "Ultra3000"),
}


class _Protocols(Mapping[str, ProtocolModule]):
    """Imports a protocol when it is first asked for: a command needs one, and starts faster."""

    def __getitem__(self, name: str) -> ProtocolModule:
        module, attribute = _WHERE[name]
        found: ProtocolModule = getattr(import_module(module), attribute)()
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(_WHERE)

    def __len__(self) -> int:
        return len(_WHERE)


PROTOCOLS: Mapping[str, ProtocolModule] = _Protocols()
"""name -> protocol"""
