from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from multidrop.errors import PortError, UsageError
from multidrop.gateway.gaps import Gap
from multidrop.gateway.outbox import OVERFLOW, Outbox


@pytest.fixture
def outbox(tmp_path: Path) -> Iterator[Outbox]:
    found = Outbox(tmp_path / "outbox.db", 100)
    yield found
    found.close()


def record(number: int, size: int = 10) -> tuple[bytes, int, int, int]:
    """Ten samples of the times 10 x number to 10 x number + 9."""
    return bytes([number]) * size, 10 * number, 10 * number + 9, 10


def numbers(outbox: Outbox, most: int = 100) -> list[int]:
    return [waiting.data[0] for waiting in outbox.take(most)]


def test_records_come_out_in_the_order_in_which_they_went_in(outbox: Outbox) -> None:
    outbox.put([record(1), record(2)])
    outbox.put([record(3)])
    assert numbers(outbox, 2) == [1, 2]
    assert numbers(outbox) == [1, 2, 3]
    assert (outbox.size, outbox.samples) == (30, 30)


def test_what_was_delivered_does_not_come_again(outbox: Outbox) -> None:
    outbox.put([record(1), record(2)])
    first, _ = outbox.take(2)
    assert not outbox.delivered
    outbox.done(first.number)
    assert numbers(outbox) == [2]
    assert (outbox.size, outbox.samples) == (10, 10)
    outbox.done(outbox.take()[0].number)
    assert outbox.delivered
    assert numbers(outbox) == []
    outbox.put([record(3)])
    assert numbers(outbox) == [3]
    assert (outbox.size, outbox.samples) == (10, 10)


def test_what_comes_after_what_was_taken_is_taken_with_it(outbox: Outbox) -> None:
    outbox.put([record(number) for number in range(9)])
    first, second = outbox.take(2)
    (third,) = outbox.take(1, second.number)
    assert [first.data[0], second.data[0], third.data[0]] == [0, 1, 2]
    outbox.put([record(9), record(10), record(11)])  # there is room for ten: the fourth goes
    assert outbox.take(1, third.number)[0].data[0] == 5
    assert outbox.take(9, 99) == []
    outbox.done(third.number)
    assert numbers(outbox)[0] == 5


def test_what_was_taken_stays_where_nothing_is_behind_it(outbox: Outbox) -> None:
    outbox.put([record(number) for number in range(10)])
    taken = outbox.take(10)
    assert outbox.take(10, taken[-1].number) == []
    outbox.put([record(10)])
    assert numbers(outbox) == list(range(11))


def test_records_wait_in_the_file(outbox: Outbox) -> None:
    outbox.put([record(1), record(2)])
    outbox.done(outbox.take()[0].number)
    outbox.close()
    again = Outbox(outbox.path, 100)
    assert numbers(again) == [2]
    assert (again.size, again.samples) == (10, 10)
    again.close()


def test_beyond_the_bound_the_oldest_go_and_the_next_one_says_so(outbox: Outbox) -> None:
    for number in range(15):
        outbox.put([record(number)])
    assert outbox.size == 100
    first, second, *_ = outbox.take(100)
    assert (first.data[0], first.lost) == (5, Gap(0, 49, OVERFLOW, 50))
    assert second.lost is None


def test_what_is_just_being_delivered_is_not_pushed_out(outbox: Outbox) -> None:
    outbox.put([record(number) for number in range(10)])
    taken = outbox.take(2)
    outbox.put([record(10), record(11)])
    outbox.done(taken[-1].number)
    waiting = outbox.take(100)
    assert [one.data[0] for one in waiting] == [4, 5, 6, 7, 8, 9, 10, 11]
    assert waiting[0].lost == Gap(20, 39, OVERFLOW, 20)


def test_what_was_not_delivered_may_be_pushed_out(outbox: Outbox) -> None:
    outbox.put([record(number) for number in range(10)])
    outbox.take(2)
    outbox.put_back()
    outbox.put([record(10), record(11)])
    assert numbers(outbox)[0] == 2


def test_a_record_larger_than_the_bound_stays_alone(outbox: Outbox) -> None:
    outbox.put([record(1), record(2, 500)])
    (only,) = outbox.take(100)
    assert (only.data[0], only.lost) == (2, Gap(10, 19, OVERFLOW, 10))


def test_a_record_without_samples_leaves_no_gap(outbox: Outbox) -> None:
    outbox.put([(b"x" * 90, 5, 5, 0), record(1), record(2)])
    assert [(one.data[0], one.lost) for one in outbox.take(9)] == [(1, None), (2, None)]


def test_where_nothing_can_be_written_nothing_has_changed(outbox: Outbox) -> None:
    outbox.put([record(1)])
    outbox._file.execute("PRAGMA query_only = 1")
    with pytest.raises(sqlite3.OperationalError):
        outbox.put([record(2)])
    outbox._file.execute("PRAGMA query_only = 0")
    assert (outbox.size, outbox.samples) == (10, 10)
    outbox.put([record(3)])
    assert numbers(outbox) == [1, 3]


def test_the_bound_is_told_in_hours(outbox: Outbox, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr("multidrop.gateway.outbox.time.monotonic", lambda: now)
    assert outbox.hours is None
    for second in range(0, 2000, 100):
        now = float(second)
        outbox.put([record(1)])
    assert outbox.hours == pytest.approx(100 / 0.1 / 3600)


def test_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.db"
    with sqlite3.connect(path) as other:
        other.execute("CREATE TABLE t (x)")
    other.close()
    with pytest.raises(UsageError, match="not an outbox of multidrop"):
        Outbox(path, 100)
    path.write_text("a text that is no database, and long enough to be told from one" * 20)
    with pytest.raises(UsageError, match="no outbox can be kept here"):
        Outbox(path, 100)
    with pytest.raises(PortError, match="no outbox can be kept here"):
        Outbox(tmp_path / "no folder" / "outbox.db", 100)


def test_how_it_is_can_be_asked_while_the_disk_takes_long(outbox: Outbox) -> None:
    """A loop asks, which must not wait for a disk."""

    def ask() -> None:
        outbox.note(1)
        assert outbox.hours is None or outbox.left is not None

    outbox.put([record(1)])
    with outbox._lock:
        asked = threading.Thread(target=ask, daemon=True)
        asked.start()
        asked.join(5)
        assert not asked.is_alive()
