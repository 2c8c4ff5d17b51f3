"""What a log should say of a plant: ports that are lost, devices that fall silent, and their return."""

from __future__ import annotations

from collections.abc import Callable

from multidrop.gateway.values import Update
from multidrop.io.poller import Quality

ANSWERS = {Quality.GOOD, Quality.REFUSED, Quality.WRONG}


class News:
    """Says each change once. `line_of` is device -> line; both begin as well."""

    def __init__(self, line_of: Callable[[str], str], say: Callable[[str], None]) -> None:
        self._line_of = line_of
        self._say = say
        self._lost: set[str] = set()
        self._silent: set[str] = set()

    def take(self, update: Update) -> None:
        """A listener of `Values`."""
        if update.quality is Quality.GOOD and not self._silent and not self._lost:
            return  # nearly always
        line = self._line_of(update.device)
        if update.quality is Quality.PORT_LOST:
            if line not in self._lost:
                self._lost.add(line)
                self._say(f"line {line}: port lost: {update.polled.error}")
            return
        if update.quality is Quality.NO_REPLY:
            if update.device not in self._silent:
                self._silent.add(update.device)
                self._say(f"{update.device}: no reply")
        elif update.quality not in ANSWERS:
            return  # stale: the line is busy, and nothing is known of the device
        elif update.device in self._silent:
            self._silent.remove(update.device)
            self._say(f"{update.device}: answers again")
        if line in self._lost:
            self._lost.remove(line)
            self._say(f"line {line}: port open again")
