"""`multidrop sniff`."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import click

from multidrop.cli import flags
from multidrop.cli.capturing import new_capture, warn_if_incomplete
from multidrop.cli.failures import failure_as_line
from multidrop.cli.listening import (
    Company,
    Listening,
    company,
    find_plant,
    listening,
    protocol_name,
)
from multidrop.cli.numbers import Seconds
from multidrop.device import ProtocolModule
from multidrop.io.connection import line_settings
from multidrop.io.ports import PortSetup, open_port
from multidrop.naming import LineOptions, parse_port
from multidrop.profile import Profile
from multidrop.protocols import PROTOCOLS
from multidrop.timing import LineSettings
from multidrop.tools.captures.listened import Listened
from multidrop.tools.captures.records import STYLES, Shown
from multidrop.tools.captures.sniff import Heard, Sniffer
from multidrop.tools.captures.tally import Tally


@click.command(
    epilog="Example: multidrop sniff /dev/ttyUSB0 --device-profile 0=flexmax -o line.pcapng"
)
@click.argument("port", metavar="PORT[,key=value]...")
@click.option("-o", "output", metavar="FILE", help="write a capture, pcapng for Wireshark")
@click.option("--seconds", type=Seconds(), metavar="S", help="end after so long")
@click.option("--quiet", "-q", is_flag=True, help="only the summary")
@partial(flags.line_keys, keys=("baud", "format", "silence", "stuffing"))
@listening
def sniff(
    asked: Listening,
    port: str,
    output: str | None,
    seconds: float | None,
    quiet: bool,
    **given: Any,
) -> None:
    """Listen to the line at PORT, and never send a byte, until Ctrl-C.

    The protocol is told by what is heard, unless it is given or follows from the
    devices. Without --baud and --format a line has what its protocol has, and
    9600 8E1 while that is not known.
    """
    style, wanted = STYLES[asked.style], asked.wanted
    name, keys = parse_port(port)
    plant = find_plant(asked.config)
    name = plant.lines.get(name, name) if plant is not None else name
    found = company(plant, name, asked.device_profiles)
    keys = {**found.keys, **keys, **flags.taken_keys(given)}
    line = _Line(name, found, keys, protocol_name(asked.protocol) or found.protocol())
    with contextlib.ExitStack() as stack:
        stack.enter_context(failure_as_line(name, asked.json, of="port"))
        opened = open_port(name, PortSetup(line.settings, line.options))
        stack.callback(opened.close)
        writer = None
        if output is not None:
            writer = new_capture(output)
            stack.callback(warn_if_incomplete, writer, output)
            stack.callback(writer.close)
        sniffer = Sniffer(
            *(opened, name, line.settings, line.protocol, line.listened),
            writer=writer,
            garbage=lambda count: _garbage(count, line.settings),
        )
        _listen(sniffer, None if quiet else style(wanted, sniffer.wall), seconds)


class _Line:
    """The line of a port: its settings before and after its protocol is known."""

    def __init__(
        self, port: str, found: Company, given: Mapping[str, str], protocol: str | None
    ) -> None:
        self._port = port
        self._found = found
        self.protocol = PROTOCOLS[protocol] if protocol is not None else None
        own = {key for each in PROTOCOLS.values() for key in each.options}
        self.options = replace(
            LineOptions.parse(given, dict.fromkeys(own, "")), rts="leave", dtr="leave"
        )
        self.settings = self._settings(self.protocol or next(iter(PROTOCOLS.values())))

    def listened(self, protocol: ProtocolModule) -> Listened:
        """The line, once its protocol is known; it goes on at the settings that it was opened with."""
        settings = self._settings(protocol).with_options(
            baud=self.settings.baud, format=self.settings.format
        )
        found = self._found
        own = {key: text for key, text in self.options.own.items() if key in protocol.options}
        return Listened(self._port, protocol, settings, found.profiles, found.names, own)

    def _settings(self, protocol: ProtocolModule) -> LineSettings:
        profile = next(iter(self._found.profiles.values()), None)
        if profile is None or profile.protocol != protocol.name:
            profile = Profile(protocol.name, protocol.name)
        return line_settings(protocol, profile, self.options)


def _listen(sniffer: Sniffer, show: Shown | None, seconds: float | None) -> None:
    """Show what is heard until the time is over, Ctrl-C, or the port is lost; then the summary."""
    tally = Tally()
    started = time.monotonic()
    told = sniffer.line is not None

    def take(heard: list[Heard]) -> None:
        for line, found in heard:
            tally.count(found, line)
            if show is not None:
                sys.stdout.write(show(found, line))
        if heard:
            sys.stdout.flush()

    if show is not None:
        sys.stdout.write(show.HEAD)
    try:
        for heard in sniffer.run():
            if not told and sniffer.line is not None:
                told = True
                click.echo(f"the line speaks {sniffer.line.protocol.name}", err=True)
            take(heard)
            if seconds is not None and time.monotonic() - started >= seconds:
                break
    finally:
        take(sniffer.finish())
        _summary(sniffer, tally, time.monotonic() - started)


def _summary(sniffer: Sniffer, tally: Tally, seconds: float) -> None:
    if sniffer.heard and sniffer.line is None:
        click.echo(
            f"{seconds:.1f} s: {sniffer.heard:,} bytes, and no frame of any protocol in them",
            err=True,
        )
        return
    if not sniffer.heard:
        click.echo(f"{seconds:.1f} s: not one byte", err=True)
        return
    for text in tally.lines(seconds):
        click.echo(text, err=True)


def _garbage(count: int, settings: LineSettings) -> None:
    click.secho(
        f"{count:,} bytes and no whole frame in them: is the line really at {settings.baud} {settings.format}? "
        "Try --baud and --format; A and B may be swapped",
        err=True,
        fg="yellow",
    )
