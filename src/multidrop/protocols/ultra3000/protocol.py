"""Ultra3000 host commands as `PROTOCOLS` holds them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from multidrop.later import Later
from multidrop.protocols import ultra3000
from multidrop.protocols.ultra3000.device import broadcast_of, device
from multidrop.protocols.ultra3000.frame import decoder
from multidrop.timing import LineSettings

if TYPE_CHECKING:
    from multidrop.protocols.ultra3000.relay import Ultra3000Relay


class Ultra3000:
    name = "ultra3000"
    link_type = 149  # LINKTYPE_USER2
    line: LineSettings = ultra3000.LINE
    options: Mapping[str, str] = {"broadcast": "broadcast address, 0..255 (as delivered 255)"}
    prober = Later("multidrop.protocols.ultra3000.probe", "PROBER")

    decoder = staticmethod(decoder)
    device = staticmethod(device)
    describe = Later("multidrop.protocols.ultra3000.describe", "describe")
    continues = Later("multidrop.protocols.ultra3000.explain", "continues")
    explain = Later("multidrop.protocols.ultra3000.explain", "explain")
    sweep = Later("multidrop.protocols.ultra3000.sweep", "sweep")
    from_master = Later("multidrop.protocols.ultra3000.describe", "from_master")
    shown = Later("multidrop.protocols.ultra3000.describe", "shown")
    prepare_broadcast = Later("multidrop.protocols.ultra3000.broadcast", "prepare_broadcast")

    @staticmethod
    def line_for(options: Mapping[str, str]) -> LineSettings:
        return ultra3000.LINE  # no option of its own changes it

    @staticmethod
    def relay(options: Mapping[str, str]) -> Ultra3000Relay:
        from multidrop.protocols.ultra3000.relay import Ultra3000Relay

        return Ultra3000Relay(broadcast_of(options))


__all__ = ["Ultra3000"]
