"""`multidrop history`: what a gateway has recorded."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

import click

from multidrop.cli import flags
from multidrop.errors import PortError, UsageError
from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.part import open_store
from multidrop.gateway.history.records import Sample
from multidrop.gateway.history.store import Store
from multidrop.gateway.plants import plant_path, read
from multidrop.gateway.settings import HistorySettings, survey_settings
from multidrop.gateway.stamps import microseconds, moment

COLUMNS = ("time", "value", "quality", "monotonic", "synchronised")
FOREVER = 2**62
"""µs, later than any sample."""


@click.group(epilog="Example: multidrop history list")
def history() -> None:
    """What `multidrop run` has recorded, also while it runs."""


@history.command("list", epilog="Example: multidrop history list")
@flags.config
def list_points(config: str | None) -> None:
    """Show of which points there is history."""
    with _store(config) as store:
        for device, point in store.series():
            click.echo(f"{device} {point}")


@history.command(
    epilog="Example: multidrop history export infeed speed --from 2026-11-22 --to 2026-11-23T06:00 -o speed.csv"
)
@click.argument("device")
@click.argument("point")
@click.option("--from", "start", metavar="TIME", help="the first time; without it, all there is")
@click.option("--to", "end", metavar="TIME", help="the time before which it ends; without it, now")
@click.option("-o", "output", metavar="FILE", help="write to FILE instead of standard output")
@click.option("--force", is_flag=True, help="overwrite FILE")
@flags.config
def export(
    device: str,
    point: str,
    start: str | None,
    end: str | None,
    output: str | None,
    force: bool,
    config: str | None,
) -> None:
    """Write what was recorded of POINT of DEVICE as CSV, in the order in which it happened.

    A TIME is 2026-11-22, 2026-11-22T14:30 or 2026-11-22T13:30:00Z, local where it has no zone.
    """
    first = 0 if start is None else _time(start)
    last = FOREVER if end is None else _time(end)
    if last <= first:
        raise UsageError("--to is not after --from")
    if output is not None and Path(output).exists() and not force:
        raise UsageError(f"{output} exists; use --force to overwrite it")
    with _store(config) as store, closing(store.range(device, point, first, last)) as samples:
        rows = _rows(samples, store.gaps(first, last))
        head = next(rows, None)  # an unknown point leaves no file
        with _written(output) as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            if head is not None:
                table.writerow(head)
            table.writerows(rows)


def _rows(samples: Iterator[Sample], gaps: list[Gap]) -> Iterator[tuple[str, ...]]:
    """A row for each sample, and one for each gap, before the first sample behind it."""
    waiting = list(reversed(gaps))
    for sample in samples:
        while waiting and waiting[-1].end <= sample.time:
            yield _gap(waiting.pop())
        known = {None: "", True: "yes", False: "no"}[sample.synchronised]
        value = "" if sample.value is None else str(sample.value)
        monotonic = f"{sample.monotonic:.6f}"
        yield _shown(sample.time), value, sample.quality.value, monotonic, known
    for gap in reversed(waiting):
        yield _gap(gap)


def _gap(gap: Gap) -> tuple[str, ...]:
    count = f", {gap.samples} samples of all points" if gap.samples is not None else ""
    return _shown(gap.start), "", f"gap until {_shown(gap.end)}: {gap.reason}{count}", "", ""


def _shown(time: int) -> str:
    return f"{moment(time).replace(tzinfo=None).isoformat(timespec='microseconds')}Z"


def _time(text: str) -> int:
    try:
        return microseconds(datetime.fromisoformat(text).astimezone(UTC))
    except (ValueError, OverflowError, OSError):
        raise UsageError(
            f"{text!r} is no time: 2026-11-22, 2026-11-22T14:30 or 2026-11-22T13:30:00Z"
        ) from None


@contextmanager
def _store(config: str | None) -> Iterator[Store]:
    settings = survey_settings(read(plant_path(config)))
    store = open_store(settings.history or HistorySettings(), settings.path, only_read=True)
    try:
        yield store
    except ValueError as error:
        raise UsageError(f"the history is damaged: {error}") from None
    except store.failures as error:
        if isinstance(error, BrokenPipeError):
            raise
        raise PortError(f"the history cannot be read: {error}") from None
    finally:
        store.close()


@contextmanager
def _written(output: str | None) -> Iterator[IO[str]]:
    if output is None:
        yield sys.stdout
        return
    try:
        file = Path(output).open("w", encoding="utf-8", newline="")  # noqa: SIM115
    except OSError as error:
        raise UsageError(f"{output}: {error.strerror}") from None
    with file:
        yield file
