"""`multidrop watch-drift`."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import click

from multidrop.cli import flags
from multidrop.cli.failures import failure, report_failure
from multidrop.cli.numbers import Seconds
from multidrop.cli.passports import shown
from multidrop.cli.words import json_line, label
from multidrop.errors import UsageError
from multidrop.gateway.settings import passports_folder
from multidrop.io.audit import jsonable
from multidrop.io.connection import Target
from multidrop.passports.difference import Difference
from multidrop.passports.drift import Drift, look, save_new
from multidrop.passports.folder import Passports
from multidrop.passports.passport import Entry
from multidrop.plantfile import Plant


@click.command(
    epilog="Example: multidrop watch-drift multidrop.toml --every 3600. "
    "Exit status 0: as in the passports, 1: something differs."
)
@click.argument("plant", metavar="PLANT.toml")
@click.option(
    "--passports",
    metavar="FOLDER",
    help="where passports are; else what [passports] says, else passports beside the plant file",
)
@click.option("--every", type=Seconds(), metavar="S", help="repeat until Ctrl-C")
@click.option(
    "--save",
    is_flag=True,
    help="a new passport of what differs, or has none; it counts from then on",
)
@flags.as_json
def watch_drift(
    plant: str, passports: str | None, every: float | None, save: bool, json: bool
) -> int:
    """Compare every device of PLANT.toml with its latest passport: what was changed at the keypad?"""
    from multidrop.cli.listening import find_plant

    found = find_plant(plant)
    assert found is not None, "a plant file that is named is read"
    folder = Path(passports) if passports else passports_folder(found)
    if save and not folder.exists() and folder.parent.is_dir():
        folder.mkdir()
    if not found.devices:
        raise UsageError(f"{plant} has no devices")
    seen: dict[str, set[str]] = {}
    started = time.monotonic()
    while True:
        status = _round(found, Passports.of(folder), seen, save=save, as_json=json)
        if every is None:
            return status
        started = max(started + every, time.monotonic() - every)
        time.sleep(max(0.0, started - time.monotonic()))


def _round(
    plant: Plant, passports: Passports, seen: dict[str, set[str]], *, save: bool, as_json: bool
) -> int:
    """All devices once. What was said the last time is not said again, nor after a silence."""
    for path, reason in passports.unusable.items():
        if seen.get(str(path)) != {reason}:
            click.secho(f"not used: {reason}", err=True, fg="yellow")
            seen[str(path)] = {reason}
    status, differ = 0, False
    for name, device in plant.devices.items():
        drift = look(name, Target(device.device, device.profile), passports)
        if save and drift.kept is None and drift.now is not None:
            drift = replace(drift, error=None)  # it gets its first one
        before = seen.get(name, set())
        lines = _lines(drift, as_json)
        for line in lines:
            if line not in before:
                click.echo(line)
        if drift.error is not None:
            status = max(status, drift.error.exit_status)
            if not as_json:
                lines.append(f"{drift.error}")
                if lines[-1] not in before:
                    report_failure(drift.error, name)
        seen[name] = {*lines, *(before if drift.now is None else ())}
        differ = differ or bool(drift.differences)
        if save and drift.now is not None and (drift.differences or drift.kept is None):
            click.echo(f"{name}: {save_new(drift, passports.folder)}", err=True)
    return 1 if differ else status


def _lines(drift: Drift, as_json: bool) -> list[str]:
    if as_json:
        lines = [_as_line(drift, item) for item in drift.differences]
        if drift.error is not None:
            lines.append(json_line({"device": drift.name, "error": failure(drift.error)}))
        return lines
    return [_as_text(drift, item) for item in drift.differences]


def _as_line(drift: Drift, item: Difference) -> str:
    assert drift.kept is not None
    assert isinstance(item.before, Entry)
    assert isinstance(item.after, Entry)
    return json_line(
        {
            "device": drift.name,
            "point": item.point,
            "name": item.name,
            "before": jsonable(item.before.value),
            "after": jsonable(item.after.value),
            "unit": item.after.unit,
            "passport": str(drift.kept.path),
            "passport_time": drift.kept.passport.time.isoformat().replace("+00:00", "Z"),
        }
    )


def _as_text(drift: Drift, item: Difference) -> str:
    assert drift.kept is not None
    where = label(item.name, item.point)
    since = f"{drift.kept.passport.time:%Y-%m-%d %H:%M} UTC"
    return f"{drift.name}: {where}   {shown(item.before)} -> {shown(item.after)}   since {since}"
