"""Memory of 1,000 simulated devices in one process.

`python -m bench.memory SHAPE` is that process: it prints its resident memory
before and after the devices are there, served over TCP and each read once.
"""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from statistics import median

from bench.measure import Result, line_of, start

DEVICES = 1000
SHAPES = {"8 lines of 125": 125, "1,000 lines of one": 1}


def resident() -> float:
    """MB (10^6 bytes) of memory that this process occupies now."""
    text = Path("/proc/self/status").read_text()
    kilobytes = next(line.split()[1] for line in text.splitlines() if line.startswith("VmRSS"))
    return int(kilobytes) * 1024 / 1e6


async def measure(on_a_line: int) -> list[float]:
    """Resident MB: with everything imported, and with the devices, each read once over TCP."""
    from multidrop.io.async_line import open_async_line
    from multidrop.protocols import slink3
    from multidrop.sim.line import SimulatedLine
    from multidrop.sim.serve import serve
    from multidrop.sim.slink3 import FlexMax

    before = resident()
    lines = [
        SimulatedLine([FlexMax(address) for address in range(on_a_line)], slink3.decoder)
        for _ in range(DEVICES // on_a_line)
    ]
    listeners = [await serve(line, "tcp://127.0.0.1:0") for line in lines]
    for listener in listeners:
        master = await open_async_line(listener.port, slink3.LINE)
        for address in range(on_a_line):
            await master.run(slink3.Master(address).read_typed(8236, slink3.Format.SHORT_INT))
        await master.close()
    after = resident()
    for listener in listeners:
        listener.close()
    return [before, after]


def memory(quick: bool) -> list[Result]:
    results = []
    for shape in SHAPES:
        found = []
        for _ in range(1 if quick else 3):
            process = start("memory", shape)
            found.append(json.loads(line_of(process.stdout)))
            process.communicate()
        before, after = (median(run[at] for run in found) for at in (0, 1))
        each = (after - before) / DEVICES * 1000
        results.append(
            Result(
                f"1,000 simulated devices in one process, {shape}",
                "",
                "< 100 MB in all",
                f"{after:.0f} MB, {each:.1f} kB each",
                after < 100,
                [f"{before:.0f} MB before the devices, {after:.0f} MB with them"],
            )
        )
    return results


if __name__ == "__main__":
    print(json.dumps(asyncio.run(measure(SHAPES[sys.argv[1]]))))
