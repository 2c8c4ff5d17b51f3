"""Datalink as `PROTOCOLS` holds it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from multidrop.conversation import Conversation
from multidrop.decoder import Decoder
from multidrop.device import Received
from multidrop.errors import UsageError
from multidrop.later import Later
from multidrop.profile import Profile
from multidrop.protocols import datalink
from multidrop.protocols.datalink.device import device, stuffing_of
from multidrop.protocols.datalink.frame import Command, Frame, decoder
from multidrop.timing import LineSettings

if TYPE_CHECKING:
    from multidrop.protocols.datalink.relay import DatalinkRelay


class Datalink:
    name = "datalink"
    link_type = 148  # LINKTYPE_USER1
    line: LineSettings = datalink.LINE
    options: Mapping[str, str] = {
        "stuffing": "on (default), or off where the instruments have byte stuffing switched off",
        "settle": "s that an instrument is given to show a change (1)",
    }
    prober = Later("multidrop.protocols.datalink.probe", "PROBER")

    decoder = staticmethod(decoder)
    device = staticmethod(device)
    describe = Later("multidrop.protocols.datalink.describe", "describe")
    continues = Later("multidrop.protocols.datalink.explain", "continues")
    explain = Later("multidrop.protocols.datalink.explain", "explain")
    sweep = Later("multidrop.protocols.datalink.sweep", "sweep")

    @staticmethod
    def shown(raw: bytes) -> str:
        return raw.hex(" ").upper()

    @staticmethod
    def line_for(options: Mapping[str, str]) -> LineSettings:
        """The line's settings with these options of its own. Raises `UsageError`."""
        return datalink.LINE if stuffing_of(options) else datalink.LINE_WITHOUT_STUFFING

    @staticmethod
    def from_master(frame: Frame) -> bool:
        return frame.command is not Command.RESPONSE

    @staticmethod
    def prepare_broadcast(
        profile: Profile,
        points: Iterable[tuple[str, str]],
        addresses: Iterable[int],
        options: Mapping[str, str],
        *,
        force: bool = False,
        keep_going: bool = False,
    ) -> Callable[[], Conversation[Frame, list[Received]]]:
        raise UsageError("Datalink has no broadcast: write each instrument by its address")

    @staticmethod
    def relay(options: Mapping[str, str]) -> DatalinkRelay:
        from multidrop.protocols.datalink.relay import DatalinkRelay

        return DatalinkRelay()


__all__ = ["Datalink", "Decoder"]
