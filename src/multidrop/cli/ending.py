"""How a command is ended from outside."""

from __future__ import annotations

import signal


def end_as_by_ctrl_c() -> None:
    """SIGTERM and a terminal that is closed end a command as Ctrl-C does.

    A write that is on its way then is recorded, and a line is closed. What was
    started to ignore a hang-up ignores it.
    """
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)
