"""Faults on demand: how they are written, and how often they are drawn."""

from __future__ import annotations

import pytest

from multidrop.errors import UsageError
from multidrop.sim.faults import Fault, NoFaults, RandomFaults, ScriptedFaults, parse_fault


@pytest.mark.parametrize(
    ("text", "rate"), [("no-answer=5%", 0.05), ("no-answer=0.05", 0.05), ("no-answer=100%", 1.0)]
)
def test_a_rate(text: str, rate: float) -> None:
    fault, found = parse_fault(text)
    assert fault is Fault.NO_ANSWER
    assert found == pytest.approx(rate)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no-anser=5%", "did you mean 'no-answer'.* faults are no-answer late-answer"),
        ("noise", "not of the form noise=5%"),
        ("noise=", "not of the form"),
        ("noise=much", "not of the form"),
        ("noise=101%", "0..100 %"),
        ("noise=-1%", "0..100 %"),
        ("noise=nan", "not of the form"),
    ],
)
def test_text_that_is_no_rate(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_fault(text)


def test_rates_that_add_up_to_too_much() -> None:
    with pytest.raises(UsageError, match="more than 100 %"):
        RandomFaults({Fault.NOISE: 0.6, Fault.CUT_SHORT: 0.5})


def test_rates_are_kept() -> None:
    faults = RandomFaults(dict.fromkeys(Fault, 0.05), seed=1)
    drawn = [faults.draw() for _ in range(20_000)]
    for fault in Fault:
        assert 0.04 < drawn.count(fault) / len(drawn) < 0.06
    left = 1 - 0.05 * len(Fault)
    assert left - 0.03 < drawn.count(None) / len(drawn) < left + 0.03


def test_the_same_seed_gives_the_same_line() -> None:
    one, same, other = (
        [faults.draw() for _ in range(200)]
        for faults in (RandomFaults({Fault.NOISE: 0.5}, seed) for seed in (7, 7, 8))
    )
    assert one == same
    assert one != other


def test_scripted_faults_come_once() -> None:
    faults = ScriptedFaults([Fault.NOISE, None, Fault.CUT_SHORT])
    assert [faults.draw() for _ in range(5)] == [Fault.NOISE, None, Fault.CUT_SHORT, None, None]
    assert NoFaults().draw() is None
