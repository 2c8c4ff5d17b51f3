"""All devices of a line polled for months: what a gateway stands on.

    python examples/line_service.py [PORT]

The line has FlexMax drives at 0 and 1; the one at 9 is switched off. It costs one
time-out, then it is only probed. Pull the adapter and plug it in again: polling goes on.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys

from multidrop.io.service import LineService, Polled

DEFAULT = os.environ.get("MULTIDROP_EXAMPLE_PORT", "tcp://127.0.0.1:4001")


def show(polled: Polled) -> None:
    """A value that is not good is the newest good one, with the reason why there is no newer."""
    reason = f" ({polled.error})" if polled.error else ""
    print(f"{polled.device:8} {polled.point.name:16} {polled.value!r}  {polled.quality}{reason}")


async def main(port: str) -> None:
    line = {name: f"flexmax:{address}@{port},timeout=0.2" for name, address in DRIVES.items()}
    async with LineService(line) as service:
        plan = service.plan([(name, ["actual_speed"], 0.5) for name in line])
        more = service.wanted([("infeed", ["status_word", "speed_setpoint"], 0.2)])
        print("polled:", plan.with_more(more))

        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(2.5):
                await service.poll(plan.adding(more), show)

        print("an operator's read:", (await service.read("press", "actual_speed"))[0].value)
        for name in line:
            counters = service.device(name).counters
            print(f"{name}: {counters.answers} answers, {counters.no_reply} without reply")
        print(f"measured: {service.load:.0%} of the line")


DRIVES = {"infeed": 0, "press": 1, "spare": 9}

if __name__ == "__main__":
    asyncio.run(main(sys.argv[1] if len(sys.argv) > 1 else DEFAULT))
