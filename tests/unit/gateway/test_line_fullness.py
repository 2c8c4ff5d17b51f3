"""How full a line is, reckoned quickly, is what a plan made anew would say."""

from __future__ import annotations

import pytest

from multidrop.gateway.line import Fullness
from multidrop.io.connection import Target
from multidrop.io.polling import Plan, Wanted

DEVICES = {"a": "flexmax:0@wire", "b": "flexmax:1@wire"}


def plan(delays: dict[str, float]) -> Plan:
    wanted = []
    for name, text in DEVICES.items():
        device = Target.of(text).device()
        for at, every in (("8236:int16", 0.5), ("actual_speed", 2.0)):
            wanted.append(Wanted(name, device, (device.point(at),), every))
    return Plan(Target.of(DEVICES["a"]).settings, wanted, delays)


@pytest.mark.parametrize("known", [{}, {"a": 0.1}])
@pytest.mark.parametrize("measured", [{}, {"a": 0.003}, {"a": 0.25, "b": 0.001, "gone": 9.0}])
def test_the_same_as_a_plan_made_anew(known: dict[str, float], measured: dict[str, float]) -> None:
    made = plan(known)
    assert Fullness(made).share(measured) == pytest.approx(made.learned(measured).load)
