"""Many devices on one line, every service of SLINK3, blocking.

    python examples/open_line.py [PORT]

The line has a FlexMax with a DGFC386 card at address 0 and a FlexMax at 1. A
`Master` only describes what it would say; `line.run` says it. Nothing is written.
"""

from __future__ import annotations

import os
import sys

import multidrop
from multidrop.protocols import slink3

DEFAULT = os.environ.get("MULTIDROP_EXAMPLE_PORT", "tcp://127.0.0.1:4001")


def main(port: str) -> None:
    with multidrop.open_line(port, slink3.LINE, timeout=0.5) as line:
        for address in (0, 1):
            drive = slink3.Master(address, slink3.FLEXMAX)
            status = line.run(drive.status_word())
            code = line.run(drive.malfunction_code()).code
            print(f"drive {address}: {status.state.value}, malfunction code {code:04X}h")

        drive = slink3.Master(0, slink3.FLEXMAX)
        parameter = line.run(drive.read_typed(8236, slink3.Format.SHORT_INT))
        speed = line.run(drive.read_standard(0x6044, 0, slink3.Format.SHORT_INT))
        print("8236 =", parameter.value)
        print("actual speed", speed.value, "rpm")

        card = slink3.Master(0, slink3.DGFC386, destination=2)  # behind the drive
        print("the card's address is", line.run(card.read_typed(511)).value)

        counters = line.counters
        print(f"{counters.requests} requests, {counters.answers} answers")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else DEFAULT)
