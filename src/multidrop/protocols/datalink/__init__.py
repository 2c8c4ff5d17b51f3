"""Micro-DCI Datalink: the 53MC5000, 53IT5100, 53ML5100, 53SL5100 and 53SL6000.

The pure protocol, host and instrument side. Sources: the 53SL6000 manual p. 125
(S) and neighbouring pages of the family's manuals (N); docs/protocols/datalink.md
has the byte tables.
"""

from dataclasses import replace
from functools import partial

from multidrop.protocols.datalink.frame import Command, Frame, UnstuffedFrame, decoder
from multidrop.protocols.datalink.master import Master
from multidrop.protocols.datalink.memory import MAP_A, MAP_B, MemoryMap
from multidrop.protocols.datalink.reals import decode_real, encode_real
from multidrop.protocols.datalink.slave import Reply, Request, Slave
from multidrop.timing import Format as CharacterFormat
from multidrop.timing import LineSettings

LINE = LineSettings(
    baud=9600,
    format=CharacterFormat(8, "E", 1),
    gap=0.0,  # no source asks for one
    byte_gap=0.100,  # 53IT5100A
    answer=0.010,  # N
    longest_frame=73,  # 38 bytes, of which 35 may need an inserted one
    decoder=decoder,
    answer_slack_serial=0.090,
    answer_slack_network=0.390,
    silence_slack_serial=0.090,
    silence_slack_network=0.390,
)
"""Line settings and timing of N; the slack is that of adapters and device servers."""

LINE_WITHOUT_STUFFING = replace(LINE, decoder=partial(decoder, stuffing=False))
"""The same for instruments whose byte stuffing is switched off (L258)."""

__all__ = [
    "LINE",
    "LINE_WITHOUT_STUFFING",
    "MAP_A",
    "MAP_B",
    "Command",
    "Frame",
    "Master",
    "MemoryMap",
    "Reply",
    "Request",
    "Slave",
    "UnstuffedFrame",
    "decode_real",
    "decoder",
    "encode_real",
]
