"""How a scan finds Datalink instruments, and tells the models apart.

The probe reads the byte at 8002h, which names the memory map: every instrument
answers a read of its memory. Map A's model number (A190, A191) says which model
it is. Map B has no name: what is known of it is where its texts begin.
"""

from __future__ import annotations

from multidrop.conversation import Conversation
from multidrop.probing import Identity
from multidrop.protocols.datalink.frame import MOST_ADDRESS, Command, Frame
from multidrop.protocols.datalink.master import Master
from multidrop.protocols.datalink.memory import MAP_A, MAP_B, MAP_IDENTIFIER_AT, SIZES
from multidrop.timing import Format

MODEL_NUMBER = 190  # A190 and A191
TAGS = {MAP_A.name: 8, MAP_B.name: 0}  # a text that says which instrument it is
MODELS = ("53mc5000", "53it5100", "53ml5100", "53sl5100")
"""Those with map A; each name is its profile's."""
MODEL_OF_MAP_B = "53sl6000"
UNKNOWN = "datalink"


class DatalinkProber:
    addresses = range(MOST_ADDRESS + 1)
    bauds = (9600, 19200, 4800, 2400, 1200, 28800, 14400, 600, 300, 110)
    formats = (Format(8, "E", 1), Format(8, "N", 1))  # L256 switches parity off

    def probe(self, address: int) -> Frame:
        return Frame(Command.INTERROGATE, address, MAP_IDENTIFIER_AT, 1)

    def identify(self, address: int) -> Conversation[Frame, Identity]:
        master = Master(address)
        found = yield from master.map_identifier()
        if found == MAP_A.identifier:
            return (yield from _of_map_a(master))
        tag = yield from _text(master, MAP_B.locate("A", TAGS[MAP_B.name]))
        if tag:
            note = f"tag {tag!r}; known by where its texts begin, for its memory map has no name"
            return Identity(MODEL_OF_MAP_B, note=note)
        return Identity(UNKNOWN, note=f"memory map identifier {found}, which no known map has")


def _of_map_a(master: Master) -> Conversation[Frame, Identity]:
    number = yield from _text(master, MAP_A.locate("A", MODEL_NUMBER), 2)
    tag = yield from _text(master, MAP_A.locate("A", TAGS[MAP_A.name]))
    said = [f"model number {number!r}" if number else "no model number"]
    if tag:
        said.append(f"tag {tag!r}")
    for model in MODELS:
        if model.upper() in number.upper():
            return Identity(model, note=", ".join(said))
    return Identity(UNKNOWN, note=", ".join([*said, "memory map A"]))


def _text(master: Master, memory_address: int, points: int = 1) -> Conversation[Frame, str]:
    """A text of `points` A points; nothing where what is there is no text."""
    raw = yield from master.interrogate(memory_address, points * SIZES["A"])
    text = raw.decode("latin-1").replace("\0", " ").strip()
    return text if text.isascii() and text.isprintable() else ""


PROBER = DatalinkProber()
