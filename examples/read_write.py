"""Read and write one drive.

    python examples/read_write.py [PORT]

PORT is where a FlexMax has address 0, such as /dev/ttyUSB0; without it
MULTIDROP_EXAMPLE_PORT, or the simulator of the README on tcp://127.0.0.1:4001.
It writes 8236, the example parameter of the SLINK3 manual, and puts it back:
leave that away on a machine whose parameter 8236 you do not know.
"""

from __future__ import annotations

import os
import sys

import multidrop

DEFAULT = os.environ.get("MULTIDROP_EXAMPLE_PORT", "tcp://127.0.0.1:4001")


def main(port: str) -> None:
    with multidrop.connect(f"flexmax:0@{port}") as drive:
        before = drive.read("8236:int16")
        print(before.name, "=", before.value, f"read in {before.ms:.1f} ms")

        written = drive.write("8236", 1234)  # sent once, read back, and only then done
        print("wrote", written.asked, written.outcome)
        drive.write("8236", before.value)

        try:
            drive.read("9999:int16")
        except multidrop.DeviceError as refusal:
            print(f"9999: {refusal}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else DEFAULT)
