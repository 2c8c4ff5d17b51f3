"""SLINK3 as `PROTOCOLS` holds it."""

from __future__ import annotations

from collections.abc import Mapping

from multidrop.decoder import Decoder
from multidrop.protocols import slink3
from multidrop.protocols.slink3.broadcast import prepare_broadcast
from multidrop.protocols.slink3.describe import describe
from multidrop.protocols.slink3.device import device
from multidrop.protocols.slink3.explain import continues, explain
from multidrop.protocols.slink3.frame import Frame, decoder
from multidrop.protocols.slink3.probe import Slink3Prober
from multidrop.protocols.slink3.relay import Slink3Relay
from multidrop.protocols.slink3.sweep import sweep
from multidrop.timing import LineSettings


class Slink3:
    name = "slink3"
    link_type = 147  # LINKTYPE_USER0
    line: LineSettings = slink3.LINE
    options: Mapping[str, str] = {
        "broadcast": "broadcast address, 128..255 (flexmax 255, ax-v 128)"
    }
    prober = Slink3Prober()

    decoder = staticmethod(decoder)
    device = staticmethod(device)
    describe = staticmethod(describe)
    continues = staticmethod(continues)
    explain = staticmethod(explain)
    sweep = staticmethod(sweep)
    prepare_broadcast = staticmethod(prepare_broadcast)

    @staticmethod
    def shown(raw: bytes) -> str:
        return raw.hex(" ").upper()

    @staticmethod
    def line_for(options: Mapping[str, str]) -> LineSettings:
        return slink3.LINE  # no option of its own changes it

    @staticmethod
    def from_master(frame: Frame) -> bool:
        return not frame.is_answer

    @staticmethod
    def relay(options: Mapping[str, str]) -> Slink3Relay:
        return Slink3Relay()


__all__ = ["Decoder", "Slink3"]
