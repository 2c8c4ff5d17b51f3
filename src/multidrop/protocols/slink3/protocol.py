"""SLINK3 as `PROTOCOLS` holds it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from multidrop.decoder import Decoder
from multidrop.later import Later
from multidrop.protocols import slink3
from multidrop.protocols.slink3.device import device
from multidrop.protocols.slink3.frame import Frame, decoder
from multidrop.timing import LineSettings

if TYPE_CHECKING:
    from multidrop.protocols.slink3.relay import Slink3Relay


class Slink3:
    name = "slink3"
    link_type = 147  # LINKTYPE_USER0
    line: LineSettings = slink3.LINE
    options: Mapping[str, str] = {
        "broadcast": "broadcast address, 128..255 (flexmax 255, ax-v 128)"
    }
    prober = Later("multidrop.protocols.slink3.probe", "PROBER")

    decoder = staticmethod(decoder)
    device = staticmethod(device)
    describe = Later("multidrop.protocols.slink3.describe", "describe")
    continues = Later("multidrop.protocols.slink3.explain", "continues")
    explain = Later("multidrop.protocols.slink3.explain", "explain")
    sweep = Later("multidrop.protocols.slink3.sweep", "sweep")
    prepare_broadcast = Later("multidrop.protocols.slink3.broadcast", "prepare_broadcast")

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
        from multidrop.protocols.slink3.relay import Slink3Relay

        return Slink3Relay()


__all__ = ["Decoder", "Slink3"]
