"""Takes the picture of `multidrop demo --terminal`: runs it in a terminal and keeps its last screen.

python docs/pictures/demo.py    writes docs/pictures/demo.svg, after 42 s
"""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import struct
import sys
import termios
from pathlib import Path

from rich.console import Console
from rich.text import Text

SECONDS = 42  # one of the drives has tripped by then
COLUMNS, LINES = 116, 40
SCREEN_AGAIN = re.compile(r"(?:\x1b\[1A|\x1b\[2K|\r)+")  # where the table is drawn anew
FONT_FROM_NETWORK = re.compile(r"\s*@font-face \{.*?\}\n", re.DOTALL)


def terminal_output() -> str:
    """What `multidrop demo` writes to a terminal."""
    child, terminal = pty.fork()
    if child == 0:
        found = f"{Path(sys.executable).parent}:{os.environ['PATH']}"  # else it shows its own path
        os.environ.update(PATH=found, TERM="xterm-256color", COLUMNS=str(COLUMNS), LINES=str(LINES))
        os.execvp("multidrop", ["multidrop", "demo", "--terminal", "--seconds", str(SECONDS)])
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("4H", LINES, COLUMNS, 0, 0))
    written = bytearray()
    while True:
        try:
            data = os.read(terminal, 65536)
        except OSError:  # the other side has closed
            break
        if not data:
            break
        written += data
    os.waitpid(child, 0)
    return written.decode()


def last_screen(output: str) -> str:
    """What stands before the live table, and the table as it was drawn last."""
    head, *tables = re.split(SCREEN_AGAIN, output.replace("\r\n", "\n"))
    before = head[: head.index("a simulated plant")].rsplit("\n", 1)[0]
    last = [table for table in tables if "winder actual_speed" in table][-1]
    return f"{before}\n{last}".rstrip()


def main() -> None:
    console = Console(
        record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True, color_system="256"
    )
    console.print(Text.from_ansi(last_screen(terminal_output())))
    svg = console.export_svg(title="multidrop demo --terminal", unique_id="demo")
    target = Path(__file__).with_suffix(".svg")
    target.write_text(FONT_FROM_NETWORK.sub("\n", svg), encoding="utf-8")
    print(target.name)


if __name__ == "__main__":
    main()
