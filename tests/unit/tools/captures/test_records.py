"""Records as JSON: the short way for samples says the same as the long one."""

from __future__ import annotations

import json
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.points import Point, PointDescription, Sample
from multidrop.protocols import PROTOCOLS
from multidrop.tools.captures.listened import Listened
from multidrop.tools.captures.records import Csv, Filter, JsonLines, Record, fields, utc

NOON = 1_700_000_000_123_456_789
SLINK3 = PROTOCOLS["slink3"]
LINE = Listened(
    "/dev/tty\"USB'0", SLINK3, SLINK3.line, {1: load_profile("flexmax")}, {1: "in, fed"}
)
PLAIN = Point("8236", "int16")
SCALED = Point("1", "int16", PointDescription("torque", "1:int16", unit="%", scale=0.1))
TEXT = Point("2", "string", PointDescription("näme", "2"))


def record(point: Point | None, sample: Sample | None, **changes: Any) -> Record:
    known = Record(1.0, 1, "read", point, sample, None, None, 31.25, 4.0, None, 'read "8236" = 7')
    return known._replace(**changes)


@pytest.mark.parametrize(
    ("point", "value", "shown"),
    [
        (PLAIN, 7, 7),
        (PLAIN, -1, -1),
        (PLAIN, True, True),
        (PLAIN, 1.5, 1.5),
        (PLAIN, float("nan"), None),
        (PLAIN, float("-inf"), None),
        (PLAIN, b"\x01\xff", "01ff"),
        (SCALED, 125, 12.5),
        (TEXT, 'a "ü"\n', 'a "ü"\n'),
    ],
)
@pytest.mark.parametrize("fault", [None, True, False])
def test_the_short_way_says_what_the_long_one_does(
    point: Point, value: Any, shown: Any, fault: bool | None
) -> None:
    show = JsonLines(Filter(), lambda at: NOON)
    one = record(point, Sample(value, "some", b"\x07\x00"), fault=fault)
    for _ in range(2):  # also from memory
        text = show.record(one, LINE, NOON)
        assert text.endswith("}\n")
        assert json.loads(text) == fields(one, LINE, NOON)
        assert list(json.loads(text)) == list(fields(one, LINE, NOON))
    assert json.loads(text)["value"] == shown


def test_points_that_differ_in_anything_are_not_mixed_up() -> None:
    show = JsonLines(Filter(), lambda at: NOON)
    sample = Sample(7, "int16", b"\x07\x00")
    for one in (
        record(PLAIN, sample),
        record(SCALED, sample),
        record(PLAIN, Sample(7, "uint16", b"\x07\x00")),
        record(PLAIN, sample, address=2),
        record(PLAIN, sample, kind="write"),
        record(PLAIN, sample, error={"kind": "refused", "code": 7, "text": "x"}),
        record(PLAIN, sample, ms=None, answer_ms=None),
        record(None, None),
        record(None, None, address=None, kind="damage", raw=b"\x01"),
    ):
        assert json.loads(show.record(one, LINE, NOON)) == fields(one, LINE, NOON)


def test_memory_has_an_end() -> None:
    show = JsonLines(Filter(), lambda at: NOON)
    points = [Point(str(number)) for number in range(JsonLines.MOST + 2)]
    for point in points:
        one = record(point, Sample(1, "int16", b""))
        assert json.loads(show.record(one, LINE, NOON))["point"] == point.text
    assert len(show._known) == 2


def test_csv_keeps_commas_and_names_errors() -> None:
    show = Csv(Filter(), lambda at: NOON)
    one = record(PLAIN, Sample(7, "int16", b"\x07\x00"), error={"kind": "refused", "text": "x"})
    assert show.record(one._replace(text="a, b"), LINE, NOON) == (
        f'{utc(NOON)},"flexmax:1@/dev/tty""USB\'0",read,8236,,7,,int16,0700,,31.25,4.0,refused,"a, b"\n'
    )
    assert Csv.HEAD.startswith("time,device,kind,point,name,value,unit,type,raw,fault,ms,")
