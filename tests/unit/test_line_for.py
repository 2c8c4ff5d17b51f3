"""A protocol's own options reach the line: what is sent and what is understood agree."""

from __future__ import annotations

import pytest

from multidrop.errors import UsageError
from multidrop.io.connection import Target
from multidrop.protocols import PROTOCOLS

UNSTUFFED = bytes.fromhex("7E 23 01 0C 02 7E B0")


def frames(port_options: str) -> list[bytes]:
    settings = Target.of(f"53mc5000:3@tcp://127.0.0.1:1{port_options}").settings
    return [event.raw for event in settings.decoder().receive_data(UNSTUFFED)]


def test_without_stuffing_a_line_reads_by_num_alone() -> None:
    assert frames(",stuffing=off") == [UNSTUFFED]
    assert frames("") == []


def test_another_word_is_refused() -> None:
    with pytest.raises(UsageError):
        frames(",stuffing=maybe")


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_protocol_has_a_line_without_options(name: str) -> None:
    assert PROTOCOLS[name].line_for({}) == PROTOCOLS[name].line
