"""Several devices on one asyncio line, each polled at its own rate.

    python examples/async_many.py [PORT]

The line has FlexMax drives at 0 and 1 and an AX-V at 2. Any number of tasks may
share a line: each conversation gets its turn, and the line keeps the gaps.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable

from multidrop import Error, open_async_line
from multidrop.conversation import Conversation
from multidrop.io.async_line import AsyncLine
from multidrop.protocols import slink3
from multidrop.protocols.slink3.master import ParameterValue

DEFAULT = os.environ.get("MULTIDROP_EXAMPLE_PORT", "tcp://127.0.0.1:4001")

Ask = Callable[[], Conversation[slink3.Frame, ParameterValue]]


async def poll(line: AsyncLine, name: str, ask: Ask, every: float, times: int) -> None:
    """One device that does not answer costs the others nothing but its time-outs."""
    for _ in range(times):
        try:
            found = await line.run(ask())
        except Error as error:
            print(f"{name}: {error}")
        else:
            print(f"{name}:", found.value, "FAULT" if found.fault else "")
        await asyncio.sleep(every)


async def main(port: str) -> None:
    infeed, press = slink3.Master(0, slink3.FLEXMAX), slink3.Master(1, slink3.FLEXMAX)
    tension = slink3.Master(2, slink3.AX_V)
    number = slink3.Format.SHORT_INT
    async with await open_async_line(port, slink3.LINE) as line, asyncio.TaskGroup() as tasks:
        polls: list[tuple[str, Ask, float, int]] = [
            ("infeed speed", lambda: infeed.read_standard(0x6044, 0, number), 0.1, 4),
            ("press speed", lambda: press.read_standard(0x6044, 0, number), 0.1, 4),
            ("tension", lambda: tension.read_typed(1009), 0.2, 2),
        ]
        for name, ask, every, times in polls:
            tasks.create_task(poll(line, name, ask, every, times))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1] if len(sys.argv) > 1 else DEFAULT))
