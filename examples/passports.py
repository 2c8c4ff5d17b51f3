"""Back up a drive, see what was changed, put it back; and find out which points a drive has.

    python examples/passports.py [PORT]

PORT is a line with a FlexMax at address 1 and an AX-V at address 2; without it
MULTIDROP_EXAMPLE_PORT, or the simulator of the README on tcp://127.0.0.1:4001.
It writes 8236, the example parameter of the SLINK3 manual, and puts it back:
leave that away on a machine whose parameter 8236 you do not know.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import multidrop
from multidrop.passports.backup import backup, load, save
from multidrop.passports.difference import differences
from multidrop.passports.restore import carry_out, plan
from multidrop.points import Role
from multidrop.tools.profiles.discover import Discovery
from multidrop.tools.profiles.text import toml_text

DEFAULT = os.environ.get("MULTIDROP_EXAMPLE_PORT", "tcp://127.0.0.1:4001")


def main(port: str) -> None:
    with multidrop.connect(f"flexmax:1@{port}") as drive:
        save(backup(drive), Path("drive.passport.toml"))
        drive.write("8236", 321)

        before = load(Path("drive.passport.toml"))
        for found in differences(before, backup(drive)):
            print(found.name, "differs")

        # 8236 has the role unknown, which a restore leaves alone unless it is named
        planned = plan(drive, before, [Role.UNKNOWN])
        for restored in carry_out(drive, planned):
            if restored.step in planned.writes:
                print(restored.step.wanted.name, restored.verdict)

    with multidrop.connect(f"ax-v:2@{port}") as drive:
        run = Discovery(drive, "1000..1019")
        print(f"about {run.estimate():.0f} s for {len(run.left)} of {len(run.sweep.places)}")
        for _ in run.run():
            pass  # a place at a time: may be interrupted
        Path("winder.toml").write_text(toml_text(run.profile("winder")), encoding="utf-8")
        print(", ".join(point.at for point in run.points))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else DEFAULT)
