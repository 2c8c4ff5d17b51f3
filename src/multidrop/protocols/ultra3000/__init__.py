"""Ultra3000 host commands: servo drives that are asked in characters, parameter by parameter.

The pure protocol, master and slave side. Source: manual 2098-RM003A-EN-P; pages
are those of its PDF, where none of its own number (1-2) is given.
"""

from multidrop.protocols.ultra3000.frame import Frame, decoder
from multidrop.protocols.ultra3000.master import Master
from multidrop.protocols.ultra3000.messages import Function, Refusal
from multidrop.protocols.ultra3000.points import View
from multidrop.protocols.ultra3000.slave import Reply, Request, Slave
from multidrop.timing import Format as CharacterFormat
from multidrop.timing import LineSettings

LINE = LineSettings(
    baud=38400,  # page 33
    format=CharacterFormat(8, "N", 1),  # page 34
    gap=0.0,
    byte_gap=1.0,
    answer=0.2,
    longest_frame=255,
    decoder=decoder,
    answer_slack_serial=0.0,
    answer_slack_network=0.3,
    silence=1.0,
)
"""Line settings as drives are delivered. The manual names no times; these are multidrop's own:
200 ms for an answer (500 ms through a network), 1 s without a character for a frame cut short."""

__all__ = [
    "LINE",
    "Frame",
    "Function",
    "Master",
    "Refusal",
    "Reply",
    "Request",
    "Slave",
    "View",
    "decoder",
]
