"""Dialogues between a master and a line, as text: `README.md` has the format.

`load_dialogues()` gives them all; `play(dialogue, stage)` plays one on anything
that can run a conversation against a `Script`, which is a peer with time as an
argument. `ExchangeStage` is the one without a line and without a clock.
"""

from dialogues.play import ExchangeStage, Played, Script, Stage, play
from dialogues.text import Dialogue, load_dialogues, parse

__all__ = [
    "Dialogue",
    "ExchangeStage",
    "Played",
    "Script",
    "Stage",
    "load_dialogues",
    "parse",
    "play",
]
