"""How a scan finds Ultra3000 drives. The probe reads the product type (000), which every drive has.

Its echo carries no value, so a line that hears itself is not taken for a drive.
"""

from __future__ import annotations

from multidrop.conversation import Conversation
from multidrop.errors import DeviceError
from multidrop.probing import Identity
from multidrop.protocols.ultra3000.frame import Frame
from multidrop.protocols.ultra3000.master import Master
from multidrop.protocols.ultra3000.messages import FIRMWARE_VERSION, LAST_ADDRESS, PRODUCT_TYPE
from multidrop.protocols.ultra3000.status import product
from multidrop.timing import Format

PROFILE = "ultra3000"


class Ultra3000Prober:
    addresses = range(LAST_ADDRESS + 1)
    bauds = (38400, 19200, 9600, 4800, 2400, 1200)  # page 33
    formats = (  # page 34
        Format(8, "N", 1),
        Format(8, "E", 1),
        Format(8, "O", 1),
        Format(7, "E", 1),
        Format(7, "O", 1),
    )

    def probe(self, address: int) -> Frame:
        return Frame(address, PRODUCT_TYPE)

    def identify(self, address: int) -> Conversation[Frame, Identity]:
        """One profile serves every type; which one it is, and its firmware, is said beside it."""
        master = Master(address)
        try:
            said = product((yield from master.read_number(PRODUCT_TYPE, 8)))
            version = yield from master.read(FIRMWARE_VERSION)
        except DeviceError as refusal:
            return Identity(PROFILE, note=f"it refuses to say what it is: {refusal.meaning}")
        if len(version) == 4:
            said += f", firmware {int(version[:2], 16)}.{int(version[2:], 16):02}"
        return Identity(PROFILE, note=said)


PROBER = Ultra3000Prober()
