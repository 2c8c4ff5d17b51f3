"""`multidrop demo`: a simulated plant, read over a real TCP line, live in the terminal."""

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
from multidrop.errors import Error, PortError
from multidrop.io.connection import Connection, Target, connect
from multidrop.naming import DeviceName
from multidrop.sim.plant import DEVICES, DemoPlant
from multidrop.sim.serve import serve

PORT_NUMBER = 4001


@click.command(epilog="Example: multidrop demo, and in another terminal what it prints")
@click.option("--listen", metavar="tcp://HOST:PORT", help="where the plant's line listens")
@click.option("--seconds", type=click.FloatRange(0.0), metavar="S", help="end after so long")
def demo(listen: str | None, seconds: float | None) -> None:
    """Start a simulated plant and show it live, until Ctrl-C.

    Three FlexMax drives and an AX-V share one simulated 9600-baud line. One of
    the drives trips now and then.
    """
    with contextlib.ExitStack() as stack:
        port = _start(stack, listen)
        click.echo(f"listening on {port}")
        click.echo("in another terminal:")
        command = _own_name()
        click.echo(f"  {command} status flexmax:3@{port}")
        click.echo(f"  {command} read flexmax:0@{port} actual_speed 8236 dgfc/511")
        click.echo(f"  {command} write ax-v:2@{port} 1111=200")
        _show(port, seconds)


def _own_name() -> str:
    """How to call this program from here: after `make demo` it is .venv/bin/multidrop."""
    called = Path(sys.argv[0])
    return str(called) if called.stem == "multidrop" and not which("multidrop") else "multidrop"


def _start(stack: contextlib.ExitStack, listen: str | None) -> str:
    """Start the plant where it was asked for; else on the usual port, or on any if that is taken."""
    if listen is not None:
        return stack.enter_context(_plant(listen))
    try:
        return stack.enter_context(_plant(f"tcp://127.0.0.1:{PORT_NUMBER}"))
    except PortError:
        return stack.enter_context(_plant("tcp://127.0.0.1:0"))


@contextlib.contextmanager
def _plant(listen: str) -> Iterator[str]:
    """The plant in a thread of its own; yields the port where it listens."""
    ready: list[str] = []
    failed: list[Error] = []
    started = threading.Event()
    loop = asyncio.new_event_loop()
    plant_task: list[asyncio.Task[None]] = []

    async def operate() -> None:
        plant_task.append(asyncio.current_task())  # type: ignore[arg-type]
        plant = DemoPlant()
        try:
            listener = await serve(plant.line, listen)
        except Error as error:
            failed.append(error)
            started.set()
            return
        ready.append(listener.port)
        started.set()
        try:
            await plant.run()
        finally:
            listener.close()

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
        yield ready[0]
    finally:
        loop.call_soon_threadsafe(plant_task[0].cancel)
        thread.join(2.0)


class _Watched:
    """One device of the plant on the screen: its points and its state."""

    def __init__(self, name: str, connection: Connection, points: tuple[str, ...]) -> None:
        self.connection = connection
        self.points = [connection.device.point(text) for text in points]
        self.rows = [Row(f"{name} {point.name}", point.unit or "") for point in self.points]

    def poll(self, table: LiveTable) -> None:
        for point, row in zip(self.points, self.rows, strict=True):
            try:
                reading = self.connection.read(point)
            except Error as error:
                changed = row.fail(str(error))
            else:
                note = self._state() if reading.fault else ""
                changed = row.show(reading.value, note, bad=bool(reading.fault))
            if changed:
                table.changed(row)

    def _state(self) -> str:
        """The fault bit came with the answer: ask what is behind it."""
        fields = self.connection.status().fields
        return f"{fields['state']}, code {fields['malfunction_code']:04X}h"


def _show(port: str, seconds: float | None) -> None:
    until = time.monotonic() + seconds if seconds is not None else float("inf")
    watched: list[_Watched] = []
    line = None
    for name, where in DEVICES.items():
        profile, _, address = where.partition(":")
        target = Target(DeviceName(profile, int(address), port, {}))
        if line is None:
            connection = connect(target)
            line = connection.line
        else:  # many devices, one line
            connection = Connection(target, target.device(), line)
        points = ("ipa_1009",) if profile == "ax-v" else ("speed_setpoint", "actual_speed")
        watched.append(_Watched(name, connection, points))
    assert line is not None
    rows = [row for device in watched for row in device.rows]
    with line, LiveTable("a simulated press line, 9600 baud", rows) as table:
        while time.monotonic() < until:
            for device in watched:
                device.poll(table)
            table.refresh()
            time.sleep(0.2)
