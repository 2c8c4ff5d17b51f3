"""SLINK3: FlexMax and AX-V drives, the DGFC386 option card, and the DRIVECOM status word.

The pure protocol, master and slave side. Sources: the FlexMax manual (A) and
the AX-V manual (B) of the protocol; docs/protocols/slink3.md has the byte tables.
"""

from multidrop.protocols.slink3.dialects import AX_V, DGFC386, FLEXMAX, SLINK3, Dialect
from multidrop.protocols.slink3.frame import Frame, decoder
from multidrop.protocols.slink3.master import Master
from multidrop.protocols.slink3.messages import Command, Response
from multidrop.protocols.slink3.slave import Reply, Request, Slave
from multidrop.protocols.slink3.status import State
from multidrop.protocols.slink3.values import Format
from multidrop.timing import Format as CharacterFormat
from multidrop.timing import LineSettings

LINE = LineSettings(
    baud=9600,
    format=CharacterFormat(8, "E", 1),
    gap=0.002,  # A 12.3.3
    byte_gap=0.006,  # A 12.3.1
    byte_gap_baud=9600,
    answer=1.5,  # A 12.3.2
    longest_frame=255,
    decoder=decoder,
)
"""Line settings and timing of A chapter 12; B has none, so they serve both."""

__all__ = [
    "AX_V",
    "DGFC386",
    "FLEXMAX",
    "LINE",
    "SLINK3",
    "Command",
    "Dialect",
    "Format",
    "Frame",
    "Master",
    "Reply",
    "Request",
    "Response",
    "Slave",
    "State",
    "decoder",
]
