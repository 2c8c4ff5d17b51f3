"""`multidrop restore`: first the plan, then a verdict for each point."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import click

from multidrop.cli.failures import failure, failure_as_line, report_failure
from multidrop.cli.options import Common, common
from multidrop.cli.passports import shown
from multidrop.cli.words import json_line, label
from multidrop.device import KeepsMemory
from multidrop.errors import Error, UsageError
from multidrop.io.audit import jsonable
from multidrop.io.connection import keeping
from multidrop.io.text_file import check_place
from multidrop.passports.backup import load, save
from multidrop.passports.restore import (
    ON_REQUEST,
    Action,
    Plan,
    Restored,
    Step,
    Verdict,
    carry_out,
    plan,
    undo,
)
from multidrop.points import Role


@click.command(
    epilog="Example: multidrop restore infeed.passport.toml ultra3000:0@/dev/ttyUSB0 --dry-run. "
    "What is never restored: measured points and commands."
)
@click.argument("file")
@click.argument("device")
@click.option("--dry-run", is_flag=True, help="show the plan and write nothing")
@click.option(
    "--include",
    type=click.Choice([role.value for role in ON_REQUEST]),
    multiple=True,
    help="restore points of this role too; may be given again",
)
@click.option("--while-enabled", is_flag=True, help="write although the device is running")
@click.option("--stop", is_flag=True, help="stop at the first point that is not restored")
@click.option("--nv", is_flag=True, help="save what was restored, where a device has such a memory")
@click.option("--undo", "undo_file", metavar="FILE", help="where the passport goes that undoes it")
@click.option("--past-limits", is_flag=True, help="write values that the profile does not allow")
@common(force="take a passport with a wrong checksum, or of other firmware", writes=True)
def restore(
    common: Common,
    file: str,
    device: str,
    dry_run: bool,
    include: tuple[str, ...],
    while_enabled: bool,
    stop: bool,
    nv: bool,
    undo_file: str | None,
    past_limits: bool,
) -> int:
    """Write the settings of a passport FILE to DEVICE, and read each of them back."""
    wanted = load(Path(file), damaged=common.force)
    target = common.target(device)
    worked_out = target.device()
    if nv:
        keeping(worked_out)
    roles = [Role(role) for role in include]
    undo_path = Path(undo_file) if undo_file else _undo_path(Path(file))
    if not dry_run:
        _check_undo(undo_path)
        common.audit().check()
    with failure_as_line(str(target.name), common.json), common.connect(target) as connection:
        planned = plan(connection, wanted, roles, force=common.force, past_limits=past_limits)
        _show_plan(common, planned, device)
        if dry_run or not planned.writes:
            return 0
        if not while_enabled:
            _demand_stopped(planned, device)
        common.confirm(f"Write {len(planned.writes)} points of {device}?", needs_yes=True)
        save(undo(connection, planned), undo_path)
        click.echo(f"{undo_path} undoes it", err=True)
        verdicts = carry_out(connection, planned, stop=stop, keep=nv)
        status = _report(common, connection.name, planned, verdicts)
    if isinstance(worked_out, KeepsMemory) and not nv:
        click.echo(
            f"only the working values: multidrop save {device} POINT... keeps them", err=True
        )
    return status


def _demand_stopped(planned: Plan, device: str) -> None:
    if planned.running is not None:
        raise UsageError(
            f"{device} says that it is running ({planned.running}); stop it first, or say"
            " --while-enabled; nothing was written"
        )


def _undo_path(file: Path) -> Path:
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%fZ")
    return file.with_name(f"{file.name.removesuffix('.toml')}.undo-{now}.toml")


def _check_undo(path: Path) -> None:
    """It replaces nothing: what is there may be the passport that is restored."""
    check_place(path, force=True)
    if path.exists():
        raise UsageError(f"{path} is there already: the undo passport needs a name of its own")


def _report(common: Common, device: str, planned: Plan, verdicts: Iterable[Restored]) -> int:
    """Each verdict as it comes; returns the highest exit status."""
    status = 0
    count: Counter[Verdict] = Counter()
    said: Error | None = None
    try:
        for done in verdicts:
            count[done.verdict] += 1
            if done.error is not None:
                status = max(status, done.error.exit_status)
            if common.json:
                click.echo(_as_line(device, done))
            else:
                _show(done)
                if done.error is not None and done.error is not said:  # one for all that are left
                    report_failure(done.error, done.step.wanted.point)
                said = done.error or said
    except KeyboardInterrupt:
        tried = count.total() - count[Verdict.SAME] - count[Verdict.SKIPPED]
        left = len(planned.writes) - tried
        click.echo(f"{_counted(count)}{left} left: run it again to go on", err=True)
        raise
    if not common.json:
        click.echo(_counted(count).removesuffix(", "))
    return status


def _counted(count: Counter[Verdict]) -> str:
    return "".join(f"{count[verdict]} {verdict}, " for verdict in Verdict if count[verdict])


def _show_plan(common: Common, planned: Plan, device: str) -> None:
    if common.json:
        for step in planned.steps:
            click.echo(_plan_line(step))
        return
    skipped = Counter(step.reason for step in planned.steps if step.action is Action.SKIP)
    same = sum(step.action is Action.SAME for step in planned.steps)
    for step in planned.writes:
        click.echo(f"{_label(step):<32} {shown(step.now)} -> {shown(step.wanted)}")
    for reason, number in skipped.items():
        click.echo(f"skipped {number:>4}: {reason}")
    running = f"; it is running: {planned.running}" if planned.running else ""
    click.echo(f"{device}: {len(planned.writes)} to write, {same} the same{running}")


def _show(done: Restored) -> None:
    if done.step.action is not Action.WRITE:
        return
    click.echo(f"{_label(done.step):<32} {shown(done.step.wanted)}   {done.verdict}")


def _label(step: Step) -> str:
    return label(step.wanted.name, step.wanted.point)


def _facts(step: Step) -> dict[str, object]:
    return {
        "point": step.wanted.point,
        "name": step.wanted.name,
        "old": jsonable(step.now.value) if step.now else None,
        "asked": jsonable(step.wanted.value),
        "unit": step.wanted.unit,
    }


def _plan_line(step: Step) -> str:
    return json_line({"plan": step.action.value, **_facts(step), "reason": step.reason or None})


def _as_line(device: str, done: Restored) -> str:
    line = {"device": device, **_facts(done.step), "verdict": done.verdict.value}
    if done.step.reason:
        line["reason"] = done.step.reason
    if done.error is not None:
        line["error"] = failure(done.error)
    return json_line(line)
