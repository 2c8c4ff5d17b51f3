"""`multidrop decode`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import click

from multidrop.cli.listening import Listening, company, find_plant, listening, protocol_name
from multidrop.errors import UsageError
from multidrop.tools.captures.decode import Decoding, Done
from multidrop.tools.captures.decode import decode as decode_capture
from multidrop.tools.captures.records import STYLES
from multidrop.tools.captures.tally import Tally

LONG = 8 << 20
"""Bytes from which on a capture shows its progress."""
MOST_NOTES = 10


@click.command(
    epilog="Example: multidrop decode line.pcapng --device-profile 2=ax-v --kind refused"
)
@click.argument("file", metavar="FILE")
@click.option("--frames", is_flag=True, help="each frame with its fields, not transactions")
@click.option("--quiet", "-q", is_flag=True, help="only the summary")
@listening
def decode(asked: Listening, file: str, frames: bool, quiet: bool) -> None:
    """Decode the capture FILE into transactions: device, point, value, answer time."""
    style, wanted = asked.style, asked.wanted
    if frames:
        if asked.csv or asked.device or asked.point or asked.kind:
            raise UsageError("--frames shows all frames, as text or with --json")
        style = "frames-json" if asked.json else "frames"
    found = company(find_plant(asked.config), _port_of(file), asked.device_profiles)
    protocol = protocol_name(asked.protocol)
    decoding = Decoding(style, wanted, protocol, found.profiles, found.names)
    done = _with_progress(decode_capture(file, decoding), file)
    head = STYLES[style].HEAD if style in STYLES else ""
    if not quiet:
        sys.stdout.write(head)
    tally, seconds, notes = Tally(), 0.0, 0
    try:
        for part in done:
            if not quiet:
                sys.stdout.write(part.text)
            tally.add(part.tally)
            seconds = part.seconds
            for note in part.notes:
                notes += 1
                if notes <= MOST_NOTES:
                    click.secho(f"{file}: {note}", err=True, fg="yellow")
    finally:
        sys.stdout.flush()
    if notes > MOST_NOTES:
        click.echo(f"{file}: and {notes - MOST_NOTES} more like these", err=True)
    if frames:
        click.echo(f"{seconds:.1f} s: {tally.frames:,} frames, {tally.damaged:,} damaged", err=True)
        return
    for line in tally.lines(seconds):
        click.echo(line, err=True)


def _port_of(file: str) -> str:
    """The port that a capture was made on, by which the plant file's devices are found."""
    from multidrop.io.captured import CaptureReader

    reader = CaptureReader(file)
    next(iter(reader.packets()), None)
    return reader.interfaces[0].name if reader.interfaces else ""


def _with_progress(parts: Iterator[Done], file: str) -> Iterator[Done]:
    """The same, with a progress bar on standard error where that is long and a terminal."""
    size = Path(file).stat().st_size
    if size < LONG or not sys.stderr.isatty() or sys.stdout.isatty():
        yield from parts
        return
    at = 0
    with click.progressbar(length=size, label="decoding", file=sys.stderr) as bar:
        for part in parts:
            yield part
            bar.update(part.end - at)
            at = part.end
