from __future__ import annotations

from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.blocks import decode, encode
from multidrop.gateway.history.packing import pack, unpack
from multidrop.gateway.history.records import QUALITIES, Kept, kept, whole
from multidrop.gateway.stamps import microseconds, moment
from unit.gateway.history.stores import START, batches, sample

VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(allow_nan=True),
    st.text(st.characters(), max_size=10),
    st.binary(max_size=6),
).map(kept)
NUMBERS = st.one_of(st.integers(-(2**53), 2**53), st.integers(-200, 200))
FLOATS = st.one_of(st.floats(allow_nan=False).map(kept), NUMBERS, st.none())
STEPS = st.one_of(st.integers(1, 2_000_000), st.integers(1, 10**12))


@st.composite
def samples(draw: st.DrawFn) -> tuple[list[int], list[Kept], list[int]]:
    steps = draw(st.lists(STEPS, max_size=30))
    size = len(steps) + 1
    kind = draw(st.sampled_from([VALUES, NUMBERS, FLOATS]))
    values = draw(st.lists(kind, min_size=size, max_size=size))
    codes = draw(st.lists(st.integers(0, len(QUALITIES) - 1), min_size=size, max_size=size))
    return (
        list(accumulate(steps, initial=START)),
        values,
        draw(st.sampled_from([codes, [0] * size])),
    )


@given(samples())
def test_a_block_gives_back_what_was_put_in(found: tuple[list[int], list[Kept], list[int]]) -> None:
    times, values, codes = found
    chunk = decode(times[0], encode(times, values, codes))
    assert list(chunk.times) == times
    back = [whole(value) if isinstance(value, float) else value for value in chunk.values]
    assert back == values
    assert list(map(type, back)) == list(map(type, values))
    assert list(chunk.codes or bytes(len(times))) == codes
    assert not chunk.plain or all(isinstance(value, int | float) for value in chunk.values)


@given(st.binary(max_size=60))
def test_other_bytes_are_no_block(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"block|version"):
        decode(START, data)


@pytest.mark.parametrize("cut", [1, 7, 8, 9, 20])
def test_a_block_that_was_cut_short_is_none(cut: int) -> None:
    data = encode([START + second for second in range(9)], [1.5] * 9, [0] * 9)
    with pytest.raises(ValueError, match="not a block"):
        decode(START, data[:cut])


def test_a_block_that_counts_more_than_it_has_is_none() -> None:
    data = bytearray(encode([START, START + 1], [1, 2], [0, 0]))
    data[4] = 9
    with pytest.raises(ValueError, match="shorter than it says"):
        decode(START, bytes(data))


def test_a_day_of_a_noisy_value_takes_few_bytes() -> None:
    times = [START + second * 1_000_000 + second * 7919 % 5000 for second in range(4000)]
    values: list[Kept] = [100 + (second * 7919 % 1000) / 10 for second in range(4000)]
    assert len(encode(times, values, [0] * 4000)) < 10 * 4000


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (True, 1),
        (5.0, 5),
        (0.5, 0.5),
        (float("nan"), None),
        (float("-inf"), float("-inf")),
        (1e300, 1e300),
        (2**60, str(2**60)),
        (b"\x00\xff", "00ff"),
        ("a\0b\ud800", "a\N{REPLACEMENT CHARACTER}b?"),
        (None, None),
    ],
)
def test_values_as_every_store_can_hold_them(value: object, found: Kept) -> None:
    said = kept(value)  # type: ignore[arg-type]
    assert said == found
    assert type(said) is type(found)


@given(st.datetimes().map(lambda time: time.astimezone()))
def test_times_are_whole_microseconds(time: object) -> None:
    from datetime import datetime

    assert isinstance(time, datetime)
    assert moment(microseconds(time)) == time


def test_a_batch_comes_out_of_the_outbox_as_it_went_in() -> None:
    found = batches(
        [sample(0, 1), sample(1, "ä", point="b"), sample(2, None), sample(3, 0.1), sample(4, -2)],
        stop=True,
    )
    gap = Gap(1, 2, "why", 3)
    assert [unpack(pack(batch)) for batch in found] == found
    assert unpack(pack(found[0]), gap).lost == (gap,)
