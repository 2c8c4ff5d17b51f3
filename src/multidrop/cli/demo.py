"""`multidrop demo`: a simulated plant on real TCP lines, with its page, or live in the terminal."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from shutil import which

import click

from multidrop.cli.live import LiveTable, Row
from multidrop.cli.numbers import Seconds
from multidrop.errors import Error, PortError, UsageError
from multidrop.io.connection import Connection, Target, connect
from multidrop.io.line import Line
from multidrop.io.ports import tcp_address
from multidrop.io.readings import in_order
from multidrop.naming import DeviceName
from multidrop.sim.plant import SHOWN, DemoPlant, Shown
from multidrop.sim.serve import serve

PORT_NUMBER = 4001
"""Of the first line; the others follow."""


@click.command(epilog="Example: multidrop demo, and in another terminal what it prints")
@click.option("--listen", metavar="tcp://HOST:PORT", help="where the plant's first line listens")
@click.option(
    "--http", metavar="HOST:PORT", help="where the page is; 127.0.0.1:8080, or any free port"
)
@click.option("--terminal", is_flag=True, help="no page: a table in this terminal")
@click.option("--seconds", type=Seconds(), metavar="S", help="end after so long")
def demo(listen: str | None, http: str | None, terminal: bool, seconds: float | None) -> None:
    """Start a simulated plant and its page, until Ctrl-C.

    Three FlexMax drives and an AX-V share one line, a 53MC5000 controls a vessel
    on the second, an Ultra3000 moves an axis on the third. One of the drives
    trips now and then. `multidrop run` polls them and serves the page; without
    what it needs they are shown in the terminal.
    """
    page = not terminal and _has_page()
    if page and http is not None:
        from multidrop.cli.demo_page import check_place

        check_place(http)
    with contextlib.ExitStack() as stack:
        ports = _start(stack, listen)
        for port in ports.values():
            click.echo(f"listening on {port}")
        click.echo("in another terminal:")
        command = _own_name()
        click.echo(f"  {command} status flexmax:3@{ports['press']}")
        click.echo(f"  {command} read flexmax:0@{ports['press']} actual_speed 8236 dgfc/511")
        click.echo(f"  {command} write ax-v:2@{ports['press']} 1111=200")
        click.echo(f"  {command} watch 53mc5000:0@{ports['vessel']} C100..C102")
        click.echo(f"  {command} write ultra3000:0@{ports['axis']} kp=5")
        if page:
            from multidrop.cli.demo_page import show_page

            show_page(ports, http, seconds)
        else:
            _show(ports, seconds)


def _has_page() -> bool:
    """Whether the extra is installed; says so where it is not."""
    from multidrop.gateway.web.part import demand_installed

    try:
        demand_installed()
    except UsageError as missing:
        click.echo(f"no page: {missing}", err=True)
        return False
    return True


def _own_name() -> str:
    """How to call this program from here: after `make demo` it is .venv/bin/multidrop."""
    called = Path(sys.argv[0])
    return str(called) if called.stem == "multidrop" and not which("multidrop") else "multidrop"


def _start(stack: contextlib.ExitStack, listen: str | None) -> dict[str, str]:
    """Start the plant where it was asked for; else on the usual ports, or on any if those are taken."""
    if listen is not None:
        return stack.enter_context(_plant(listen))
    try:
        return stack.enter_context(_plant(f"tcp://127.0.0.1:{PORT_NUMBER}"))
    except PortError:
        return stack.enter_context(_plant("tcp://127.0.0.1:0"))


def _addresses(first: str, count: int) -> list[str]:
    """Where each line listens: the ports from the first on, or any."""
    if not first.startswith("tcp://"):
        raise UsageError(f"{first!r} is not of the form tcp://HOST:PORT")
    host, number = tcp_address(first)
    shown = f"[{host}]" if ":" in host else host
    return [f"tcp://{shown}:{number + place if number else 0}" for place in range(count)]


@contextlib.contextmanager
def _plant(listen: str) -> Iterator[dict[str, str]]:
    """The plant in a thread of its own; yields where each of its lines listens."""
    plant = DemoPlant()
    addresses = _addresses(listen, len(plant.lines))
    ready: dict[str, str] = {}
    failed: list[Error] = []
    started = threading.Event()
    loop = asyncio.new_event_loop()
    plant_task: list[asyncio.Task[None]] = []

    async def operate() -> None:
        plant_task.append(asyncio.current_task())  # type: ignore[arg-type]
        async with contextlib.AsyncExitStack() as listeners:
            try:
                for (name, line), address in zip(plant.lines.items(), addresses, strict=True):
                    listener = await serve(line, address)
                    listeners.callback(listener.close)
                    ready[name] = listener.port
            except Error as error:
                failed.append(error)
                return
            finally:
                started.set()
            await plant.run()

    def work() -> None:
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(operate())
        loop.close()

    thread = threading.Thread(target=work, name="simulated plant", daemon=True)
    thread.start()
    started.wait()
    if failed:
        thread.join()
        raise failed[0]
    try:
        yield ready
    finally:
        loop.call_soon_threadsafe(plant_task[0].cancel)
        thread.join(2.0)


class _Watched:
    """One device of the plant on the screen: its points and its state."""

    def __init__(self, shown: Shown, connection: Connection) -> None:
        self.connection = connection
        self.points = [connection.device.point(text) for text in shown.points]
        self.rows = [Row(f"{shown.name} {point.name}", point.unit or "") for point in self.points]

    def poll(self, table: LiveTable) -> None:
        for row, (_, found) in zip(self.rows, in_order(self.connection, self.points), strict=True):
            if isinstance(found, Error):
                changed = row.fail(str(found))
            else:
                note = self._state() if found.fault else ""
                changed = row.show(found.value, note, bad=bool(found.fault))
            if changed:
                table.changed(row)

    def _state(self) -> str:
        """The fault bit came with the answer: ask what is behind it."""
        try:
            fields = self.connection.status().fields
        except Error as error:
            return f"in fault: {error}"
        return f"{fields['state']}, code {fields['malfunction_code']:04X}h"


def _show(ports: dict[str, str], seconds: float | None) -> None:
    until = time.monotonic() + seconds if seconds is not None else float("inf")
    lines: dict[str, Line] = {}
    with contextlib.ExitStack() as opened:
        watched = [_watched(shown, ports[shown.line], lines, opened) for shown in SHOWN]
        rows = [row for device in watched for row in device.rows]
        table = opened.enter_context(LiveTable("a simulated plant on three lines", rows))
        while time.monotonic() < until:
            for device in watched:
                device.poll(table)
            table.refresh()
            time.sleep(0.1)


def _watched(
    shown: Shown, port: str, lines: dict[str, Line], opened: contextlib.ExitStack
) -> _Watched:
    """A device on its line, which the first of its devices opens."""
    target = Target(DeviceName(shown.profile, shown.address, port, {}))
    if shown.line not in lines:
        lines[shown.line] = opened.enter_context(connect(target)).line
    return _Watched(shown, Connection(target, target.device(), lines[shown.line]))
