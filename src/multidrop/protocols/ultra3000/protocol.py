"""Ultra3000 host commands as `PROTOCOLS` holds them."""

from __future__ import annotations

from collections.abc import Mapping

from multidrop.protocols import ultra3000
from multidrop.protocols.ultra3000.broadcast import prepare_broadcast
from multidrop.protocols.ultra3000.describe import describe, from_master, shown
from multidrop.protocols.ultra3000.device import broadcast_of, device
from multidrop.protocols.ultra3000.explain import continues, explain
from multidrop.protocols.ultra3000.frame import decoder
from multidrop.protocols.ultra3000.probe import Ultra3000Prober
from multidrop.protocols.ultra3000.relay import Ultra3000Relay
from multidrop.protocols.ultra3000.sweep import sweep
from multidrop.timing import LineSettings


class Ultra3000:
    name = "ultra3000"
    link_type = 149  # LINKTYPE_USER2
    line: LineSettings = ultra3000.LINE
    options: Mapping[str, str] = {"broadcast": "broadcast address, 0..255 (as delivered 255)"}
    prober = Ultra3000Prober()

    decoder = staticmethod(decoder)
    device = staticmethod(device)
    describe = staticmethod(describe)
    continues = staticmethod(continues)
    explain = staticmethod(explain)
    sweep = staticmethod(sweep)
    from_master = staticmethod(from_master)
    shown = staticmethod(shown)
    prepare_broadcast = staticmethod(prepare_broadcast)

    @staticmethod
    def line_for(options: Mapping[str, str]) -> LineSettings:
        return ultra3000.LINE  # no option of its own changes it

    @staticmethod
    def relay(options: Mapping[str, str]) -> Ultra3000Relay:
        return Ultra3000Relay(broadcast_of(options))


__all__ = ["Ultra3000"]
