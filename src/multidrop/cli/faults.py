"""`multidrop faults`: what was kept when a device tripped."""

from __future__ import annotations

import json as json_module
from datetime import datetime
from typing import Any

import click

from multidrop.cli import flags
from multidrop.cli.numbers import WholeFrom
from multidrop.errors import UsageError
from multidrop.gateway.faults.freeze_frames import FreezeFrame, FreezeFrames
from multidrop.gateway.plants import plant_path, read
from multidrop.gateway.settings import FaultSettings, survey_settings


@click.command(
    epilog="Example: multidrop faults winder, and multidrop faults winder 2 for the last but one"
)
@click.argument("device")
@click.argument("number", type=WholeFrom(min=1), required=False, metavar="[NUMBER]")
@flags.as_json
@flags.config
def faults(device: str, number: int | None, json: bool, config: str | None) -> None:
    """Show the freeze-frames that `multidrop run` kept of DEVICE when it tripped.

    All of them in a line each, and the newest whole; or the one with NUMBER, 1 being the newest.
    """
    plant = read(plant_path(config))
    settings = survey_settings(plant)
    chosen = settings.faults or FaultSettings()
    kept = FreezeFrames(settings.path(chosen.path), chosen.keep)
    names = kept.names(device)
    if not names:
        plant.find(device)  # or says which there are
    if number is not None and number > len(names):
        raise UsageError(f"{device} has {len(names)} freeze-frames, and no number {number}")
    shown = names if number is None else names[number - 1 : number]
    frames = [kept.load(device, name) for name in shown]
    if json:
        for frame in frames:
            click.echo(json_module.dumps(frame, ensure_ascii=False))
    elif not frames:
        click.echo(f"{device}: no freeze-frame is kept")
    else:
        if number is None:
            _list(frames)
        _show(frames[0])


def _list(frames: list[FreezeFrame]) -> None:
    for number, frame in enumerate(frames, 1):
        until = f"until {_local(frame['cleared'])}" if frame["cleared"] else "not cleared"
        click.echo(f"{number:3}  {_local(frame['time'])}  {until:<29}  {_what(frame)}".rstrip())
    click.echo()


def _what(frame: FreezeFrame) -> str:
    """The fault in a word or two, where the device has a code for it."""
    code = (frame["status"] or {}).get("malfunction_code")
    return "" if code is None else f"malfunction code {code:04X}h"


def _show(frame: FreezeFrame) -> None:
    found = ", found when it was first heard" if frame["found"] else ""
    _head(f"{frame['device']} ({frame['name']}) {_local(frame['time'])}{found}")
    for line in frame["status_lines"]:
        click.echo(f"  {line}")
    if frame["status_error"]:
        click.echo(f"  no status: {frame['status_error']}")
    if frame["read"]:
        _head("read then")
        for item in frame["read"]:
            click.echo(f"  {item['point']:<24} {_value(item)}")
    _head("before")
    for item in frame["before"]:
        quality = "" if item["quality"] == "good" else f"  ({item['quality']})"
        click.echo(f"  {item['s']:8.3f} s  {item['point']:<24} {_value(item)}{quality}")
    _head("on the line")
    for item in frame["frames"]:
        arrow = ">" if item["sent"] else "<"
        click.echo(f"  {_local(item['time'])}  {arrow} {item['shown']}")
        click.echo(f"  {'':25}    {item['text']}")


def _head(text: str) -> None:
    click.secho(text, bold=True)


def _value(item: dict[str, Any]) -> str:
    if "error" in item:
        return str(item["error"])
    unit = f" {item['unit']}" if item["unit"] else ""
    meaning = f"  {item['meaning']}" if item["meaning"] else ""
    value = item["value"]
    shown = "-" if value is None else f"{value:.7g}" if isinstance(value, float) else str(value)
    return f"{shown}{unit}{meaning}"


def _local(time: str) -> str:
    """A time as the clock on the wall had it."""
    return datetime.fromisoformat(time).astimezone().isoformat(" ", "milliseconds")[:23]
