"""`multidrop run` and `multidrop check`: a plant as its file describes it."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import signal
from pathlib import Path
from typing import Any

import click

from multidrop.cli import flags
from multidrop.cli.failures import failure
from multidrop.cli.registers import print_registers
from multidrop.cli.words import counted, json_line, utc
from multidrop.errors import UsageError
from multidrop.gateway.check import Checked
from multidrop.gateway.check import check as check_plant
from multidrop.gateway.gateway import Gateway, Reloaded
from multidrop.gateway.news import News
from multidrop.gateway.plants import load, plant_path, read
from multidrop.gateway.settings import settings_of
from multidrop.gateway.values import Update
from multidrop.io.audit import jsonable


@click.command(epilog="Example: multidrop check, or multidrop check /etc/multidrop/multidrop.toml")
@click.argument("file", required=False, metavar="[FILE]")
@flags.as_json
@click.option("--registers", is_flag=True, help="the register map of [modbus] instead of the lines")
def check(file: str | None, json: bool, registers: bool) -> None:
    """Find what is wrong with a plant file, all of it, before anything is opened.

    Prints how full the polls make each line.
    """
    plant = read(plant_path(file))
    checked = check_plant(plant)
    if registers and not checked.wrong:
        print_registers(plant, json=json)
    elif json:
        _print_json(checked)
    elif checked.lines:
        _print_table(checked)
    if checked.wrong:
        raise UsageError("\n".join(checked.wrong))


def _print_json(checked: Checked) -> None:
    for line in checked.lines:
        facts = {"line": line.name, "port": line.port, "settings": line.settings}
        counts = {"devices": line.devices, "points": line.points, "load": round(line.load, 4)}
        click.echo(json_line({**facts, **counts}))
    for text in checked.wrong:
        click.echo(json_line({"error": {"kind": UsageError.kind, "text": text}}))


def _print_table(checked: Checked) -> None:
    rows = [("line", "settings", "devices", "points", "load", "port")]
    for line in checked.lines:
        load = f"{line.load:.0%}".replace("%", " %")
        rows.append(
            (line.name, line.settings, str(line.devices), str(line.points), load, line.port)
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    for name, settings, *numbers, port in rows:
        cells = [name.ljust(widths[0]), settings.ljust(widths[1])]
        cells += [number.rjust(width) for number, width in zip(numbers, widths[2:], strict=True)]
        click.echo("  ".join([*cells, port]))


@click.command(
    epilog="Example: multidrop run, or multidrop run /etc/multidrop/multidrop.toml. SIGHUP reads the "
    "file again; SIGTERM and Ctrl-C end it."
)
@click.argument("file", required=False, metavar="[FILE]")
@click.option("--json", is_flag=True, help="every update as a JSON line on standard output")
def run(file: str | None, json: bool) -> None:
    """Poll a plant, and serve what comes to the parts that its file switches on."""
    path = plant_path(file)
    asyncio.run(run_plant(path, Said(json)))


class Said:
    """What is printed: for people what listens where and what has changed, else every update."""

    def __init__(self, json: bool) -> None:
        self._json = json

    def ready(self, text: str) -> None:
        click.echo(text, err=self._json)

    def news(self, text: str) -> None:
        click.echo(text, err=True)

    def update(self, update: Update) -> None:
        """A listener of `Values`."""
        if self._json:
            click.echo(json_line(update_facts(update)))


def update_facts(update: Update) -> dict[str, Any]:
    """An update as JSON. `time` is that of the value, null where there is none yet."""
    polled, reading = update.polled, update.polled.reading
    line: dict[str, Any] = {
        "device": update.device,
        "point": update.point,
        "quality": polled.quality.value,
        "value": None if reading is None else jsonable(reading.value),
        "unit": polled.point.unit,
        "time": None if reading is None else utc(reading.time),
        "at": utc(polled.time),
        "synchronised": update.synchronised,
    }
    if reading is not None:
        line |= {"raw": reading.raw_text, "fault": reading.fault, "meaning": reading.meaning}
    if polled.error is not None:
        line["error"] = failure(polled.error)
    return line


async def run_plant(path: Path, said: Said) -> None:
    """Run until SIGTERM or Ctrl-C."""
    plant = load(path)
    gateway = Gateway(plant, settings_of(plant), say=said.ready, news=said.news)
    gateway.add_parts()
    news = News(lambda device: gateway.device(device).line, said.news)
    gateway.values.listeners += [news.take, said.update]
    async with gateway:
        gc.collect()
        gc.freeze()  # the plant stays: to look through it again and again takes tens of milliseconds
        running = asyncio.ensure_future(gateway.run())
        reloads: set[asyncio.Task[None]] = set()

        def reload() -> None:
            task = asyncio.create_task(_reload(gateway, path, said))
            reloads.add(task)
            task.add_done_callback(reloads.discard)

        with contextlib.suppress(NotImplementedError, AttributeError):  # Windows
            loop = asyncio.get_running_loop()
            loop.add_signal_handler(signal.SIGTERM, running.cancel)
            loop.add_signal_handler(signal.SIGHUP, reload)
        count = len(plant.devices)
        said.news(f"polling {counted(count, 'device')} on {counted(len(plant.lines), 'line')}")
        try:
            await running
        except asyncio.CancelledError:
            current = asyncio.current_task()
            if current is not None and current.cancelling():  # Ctrl-C, not SIGTERM
                raise
        finally:
            for task in reloads:
                task.cancel()


async def _reload(gateway: Gateway, path: Path, said: Said) -> None:
    """Read the file again; where it is wrong, all stays as it was."""
    try:
        plant = await asyncio.to_thread(load, path)
        tables = plant.tables != gateway.plant.tables
        done = await gateway.reload(plant)
    except UsageError as error:
        said.news(f"not reloaded: {error}")
        return
    said.news(f"reloaded: {_shown(done)}")
    if tables:
        said.news("what changed beside the lines counts from the next start on")


def _shown(done: Reloaded) -> str:
    parts = {
        "started": done.started,
        "changed": done.changed,
        "stopped": done.stopped,
        "unchanged": done.kept,
    }
    return ", ".join(f"{name} {' '.join(lines)}" for name, lines in parts.items() if lines)
