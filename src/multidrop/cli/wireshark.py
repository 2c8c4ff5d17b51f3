"""`multidrop wireshark` and `multidrop extcap`: multidrop inside Wireshark."""

from __future__ import annotations

import contextlib
import signal
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO

import click

from multidrop.cli.flags import as_json
from multidrop.cli.words import json_line
from multidrop.errors import UsageError
from multidrop.io.list_ports import list_ports


@click.command(epilog="Example: multidrop wireshark --install")
@click.option("--install", is_flag=True, help="put both files into your Wireshark folders")
@as_json
def wireshark(install: bool, json: bool) -> None:
    """The dissector and the extcap for Wireshark: where they are, and where they go."""
    from multidrop.tools.captures import wireshark as placing

    where = placing.folders()
    dissector, extcap = where.files
    if install:
        placing.install(where)
    if json:
        paths = {"shipped": placing.DISSECTOR, "dissector": dissector, "extcap": extcap}
        facts = {name: str(path) for name, path in paths.items()}
        click.echo(json_line({**facts, "wireshark": where.found, "installed": install}))
        return
    if where.found is None:
        click.echo("Wireshark was not found here; these are its usual folders", err=True)
    if install:
        click.echo(f"dissector   {dissector}   written")
        click.echo(f"extcap      {extcap}   written")
        click.echo("Start Wireshark anew, or press Ctrl+Shift+L and F5.")
    else:
        click.echo(f"dissector   {placing.DISSECTOR}")
        click.echo(f"            goes to {dissector}")
        click.echo(f"extcap      a script for {extcap}")
        click.echo("multidrop wireshark --install puts them there; nothing was written.")


@click.command(
    epilog="Example: multidrop extcap --extcap-interface multidrop --capture --fifo /tmp/line.pcapng "
    "--port /dev/ttyUSB0 --protocol slink3"
)
@click.option("--extcap-interfaces", is_flag=True, help="name the interfaces")
@click.option("--extcap-version", metavar="X.Y", help="the version of Wireshark that asks")
@click.option("--extcap-interface", metavar="NAME", default="", help="the interface in question")
@click.option("--extcap-dlts", is_flag=True, help="name the link types of an interface")
@click.option("--extcap-config", is_flag=True, help="name the settings of an interface")
@click.option("--extcap-capture-filter", metavar="TEXT", help="none is known")
@click.option("--capture", is_flag=True, help="listen, until nobody reads any more")
@click.option("--fifo", metavar="FILE", help="where the capture is written to")
@click.option("--port", metavar="PORT", default="", help="/dev/... or tcp://HOST:PORT")
@click.option(
    "--protocol", metavar="NAME", default="", help="a protocol, or auto: told by what is heard"
)
@click.option("--baud", metavar="RATE", default="", help="baud rate")
@click.option("--format", metavar="8E1", default="", help="data bits, parity, stop bits")
@click.option("--stuffing", metavar="on|off", default="", help="byte stuffing (datalink)")
def extcap(**given: Any) -> None:
    """What Wireshark calls to listen to a line. It never sends a byte."""
    from multidrop.tools.captures import extcap as answers

    interface = given["extcap_interface"]
    if given["extcap_interfaces"]:
        _say(answers.interfaces(list_ports()))
    elif not interface:
        raise UsageError("Wireshark calls this; for people: multidrop wireshark --install")
    elif given["extcap_dlts"]:
        _say(answers.link_types())
    elif given["extcap_config"]:
        _say(answers.settings(interface))
    elif given["capture"]:
        _capture(interface, given)
    elif given["extcap_capture_filter"]:
        _say([f"there are no capture filters: {given['extcap_capture_filter']!r}"])


def _say(lines: list[str]) -> None:
    click.echo("\n".join(lines))


def _capture(interface: str, given: dict[str, Any]) -> None:
    """Listen until Wireshark ends it: by a signal, or because it reads no longer."""
    from multidrop.tools.captures.extcap import Listening, capture, port_of

    if given["fifo"] is None:
        raise UsageError("where to? --fifo FILE")
    port = port_of(interface, list_ports(), given["port"])
    options = {key: given[key] for key in ("baud", "format", "stuffing")}
    listening = Listening.parse(port, given["protocol"], options)

    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, end)
    with contextlib.suppress(KeyboardInterrupt), _opened(given["fifo"]) as file:
        capture(listening, file)


def _opened(path: str) -> BinaryIO:
    """A FIFO opens when somebody reads it. Raises `UsageError`."""
    try:
        return Path(path).open("wb", buffering=0)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None
