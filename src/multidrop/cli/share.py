"""`multidrop share`."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import click

from multidrop.cli.failures import failure_as_line
from multidrop.cli.options import Common, common
from multidrop.cli.words import json_line, utc
from multidrop.errors import UsageError
from multidrop.io.audit import AuditLog
from multidrop.io.listen import Listener
from multidrop.naming import parse_port
from multidrop.protocols import PROTOCOLS
from multidrop.tools.share.client import Counts
from multidrop.tools.share.port import targets
from multidrop.tools.share.share import Event, Rules, Share


@click.command(
    epilog="Example: multidrop share /dev/ttyUSB0 --listen tcp://127.0.0.1:4001 - then, in another "
    "terminal: multidrop read flexmax:0@tcp://127.0.0.1:4001 8236"
)
@click.argument("port", metavar="PORT[,key=value]...")
@click.option("--listen", metavar="WHERE", help="tcp://127.0.0.1:4001 or pty[:LINK]")
@click.option(
    "--protocol",
    type=click.Choice(list(PROTOCOLS)),
    metavar="P",
    help=f"{', '.join(PROTOCOLS)}; else told by the first frame of a client",
)
@click.option("--allow-writes", is_flag=True, help="let pass what is no read, too")
@common(force="go on without an audit log")
def share(
    common: Common, port: str, listen: str | None, protocol: str | None, allow_writes: bool
) -> None:
    """Let many masters use one PORT, over TCP: each hears the answers to its own requests.

    They only read, unless --allow-writes; every write is recorded.
    """
    if listen is None:
        raise UsageError("where? --listen tcp://127.0.0.1:4001 or --listen pty:/tmp/line")
    if common.profile:
        raise UsageError("--profile: frames pass as they are, no profile is needed")
    name, keys = parse_port(port)
    found = targets(name, {**keys, **common.keys})
    audit = AuditLog(origin="share", force=common.force)
    with failure_as_line(name, common.json, of="port"):
        asyncio.run(_share(common, found, Rules(audit, allow_writes, protocol), listen))


async def _share(common: Common, found: Any, rules: Rules, where: str) -> None:
    """Share until Ctrl-C or SIGTERM, then say what was done."""
    said = _Said(common.json)
    sharing = Share(found, rules, said.event, common.tap)
    running = asyncio.ensure_future(sharing.run(where, lambda at: said.ready(at, rules)))
    with contextlib.suppress(NotImplementedError):  # Windows
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, running.cancel)
    try:
        await running
    except asyncio.CancelledError:
        said.summary(sharing.counts)
        current = asyncio.current_task()
        if current is not None and current.cancelling():  # Ctrl-C, not SIGTERM
            raise


class _Said:
    """What is said of it: lines on standard error, or JSON Lines on standard output."""

    def __init__(self, json: bool) -> None:
        self._json = json

    def ready(self, listener: Listener, rules: Rules) -> None:
        if self._json:
            self._object("listening", port=listener.port)
        else:
            click.echo(f"listening on {listener.port}")
        if not listener.loopback:
            do = "read and write" if rules.allow_writes else "read"
            click.secho(
                f"warning: a raw socket asks for no password: whoever reaches {listener.port} can "
                f"{do} every device on the line",
                err=True,
                fg="yellow",
            )

    def event(self, event: Event) -> None:
        if self._json:
            self._object(event.kind, client=event.client, text=event.text)
        else:
            click.echo(event.text, err=True)

    def summary(self, counts: Counts) -> None:
        if self._json:
            self._object("summary", **asdict(counts))
        else:
            click.echo(counts.shown(), err=True)

    def _object(self, event: str, **facts: Any) -> None:
        click.echo(json_line({"event": event, "time": utc(datetime.now(UTC)), **facts}))
