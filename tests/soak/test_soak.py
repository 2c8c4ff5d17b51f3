"""No wrong value, no hang, and of no write more is said than is true.

`MULTIDROP_SOAK=1` runs 10,000 transactions of each kind, else a few hundred.
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from integration.virtual_time import VirtualTimeLoop, WireTransport

from multidrop.errors import Error
from multidrop.io.async_line import AsyncLine
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.naming import LineOptions
from multidrop.protocols import slink3
from multidrop.sim.faults import Fault, RandomFaults, ScriptedFaults
from multidrop.sim.line import SimulatedLine
from soak.faulty import Check, Tally, WritesSent, every_fault, faulty_line, targets, transactions

SOAK = "MULTIDROP_SOAK" in os.environ
COUNT = 10_000 if SOAK else 400
PATIENCE = 30.0
"""s of the wire's own time that no transaction may take: reads before and after, three attempts each."""

Runner = Callable[[Check], str]


def blocking(wire: SimulatedLine, options: LineOptions) -> Runner:
    port = MemoryPort(wire.attach())
    line = Line(port, slink3.LINE, options)
    sent = WritesSent()
    line.taps.append(sent)

    def run(check: Check) -> str:
        sent.count, started = 0, port.now()
        try:
            result = line.run(check.conversation())
        except Error as error:
            found = check.raised(error, sent.count)
        else:
            found = check.returned(result, sent.count)
        assert port.now() - started < PATIENCE
        return found

    return run


async def in_asyncio(wire: SimulatedLine, options: LineOptions, checks: Iterable[Check]) -> Tally:
    line = AsyncLine(slink3.LINE, options, network=False)
    WireTransport(wire.attach(), line)
    sent = WritesSent()
    line.taps.append(sent)
    tally = Tally()
    for check in checks:
        sent.count = 0
        try:
            result = await line.run(check.conversation())
        except Error as error:
            tally.count(check.raised(error, sent.count))
        else:
            tally.count(check.returned(result, sent.count))
    await line.close()
    return tally


def enough(tally: Tally) -> None:
    """The wire was as bad as it was meant to be, and most transactions came through."""
    total = sum(tally.outcomes.values())
    assert tally.outcomes["read"] > 0.4 * total
    assert tally.outcomes["write confirmed"] > 0.2 * total
    if total >= 10_000:
        assert tally.outcomes["write unknown"] > 10
        assert tally.outcomes["write without old value"] > 10
        assert tally.outcomes["read without answer"] > 10


@pytest.mark.parametrize("late", [0.5, 1.6, 2.9])
@pytest.mark.parametrize("echo", ["on", "off", "auto"])
def test_every_fault_at_once(echo: str, late: float) -> None:
    seed = 20 * len(echo) + int(10 * late)
    dice = random.Random(seed)
    devices, found = targets()
    wire = faulty_line(devices, every_fault(0.05, seed), late, echo != "off")
    run = blocking(wire, LineOptions(echo=echo))
    tally = Tally()
    for check in transactions(found, dice, COUNT):
        tally.count(run(check))
    enough(tally)


@pytest.mark.parametrize("echo", ["on", "off"])
def test_every_fault_at_once_in_asyncio(echo: str) -> None:
    devices, found = targets()
    wire = faulty_line(devices, every_fault(0.05, 5), 1.6, echo == "on")
    checks = transactions(found, random.Random(6), COUNT)
    loop = VirtualTimeLoop()
    try:
        tally = loop.run_until_complete(in_asyncio(wire, LineOptions(echo=echo), checks))
    finally:
        loop.close()
    enough(tally)


@pytest.mark.parametrize("fault", Fault)
@pytest.mark.parametrize("rate", [0.3, 1.0])
def test_one_fault_alone(fault: Fault, rate: float) -> None:
    devices, found = targets()
    wire = faulty_line(devices, RandomFaults({fault: rate}, 3), 1.6, False)
    run = blocking(wire, LineOptions(echo="off"))
    tally = Tally()
    for check in transactions(found, random.Random(4), COUNT // 8):
        tally.count(run(check))
    assert ("read" in tally.outcomes) is (fault in (Fault.NOISE, Fault.TWICE) or rate < 1)


@settings(max_examples=COUNT // 4)
@given(
    faults=st.lists(st.none() | st.sampled_from(Fault), max_size=30),
    late=st.sampled_from([0.2, 1.55, 2.0, 2.9]),
    echo=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_faults_that_hypothesis_draws(
    faults: list[Fault | None], late: float, echo: bool, seed: int
) -> None:
    devices, found = targets()
    wire = faulty_line(devices, ScriptedFaults(faults), late, echo)
    run = blocking(wire, LineOptions())
    for check in transactions(found, random.Random(seed), 6):
        run(check)
