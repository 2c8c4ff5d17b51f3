"""The demonstration's page: `multidrop run` on the simulated plant."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import click

from multidrop.cli.run import Said, run_plant
from multidrop.errors import UsageError
from multidrop.gateway.web.access import is_loopback, split_address
from multidrop.gateway.web.tokens import Right, make_token

USUAL = "127.0.0.1:8080"


def check_place(http: str) -> None:
    """Of the page, before anything is started. Raises `UsageError`."""
    try:
        host, _ = split_address(http)
    except UsageError:
        raise UsageError(f"--http {http!r} is not HOST:PORT") from None
    if not is_loopback(host):
        raise UsageError("the demo is for this machine alone: --http 127.0.0.1:PORT")


def show_page(ports: Mapping[str, str], http: str | None, seconds: float | None) -> None:
    """Serve it until Ctrl-C, or for so many seconds. Its files are gone afterwards."""
    text = files("multidrop.sim").joinpath("demo.toml").read_text(encoding="utf-8")
    for name, place in {**ports, "http": http or _usual_or_any()}.items():
        text = text.replace(f'"{{{name}}}"', f'"{place}"')
    with tempfile.TemporaryDirectory(prefix="multidrop-demo-") as folder:
        plant = Path(folder, "multidrop.toml")
        plant.write_text(text, encoding="utf-8")
        token = make_token(Path(folder, "tokens.toml"), "demo", [Right.READ, Right.WRITE])
        click.echo(f"plant file: {plant}")
        click.echo(f"token for writing: {token}")
        with contextlib.suppress(TimeoutError):
            asyncio.run(_for(seconds, plant))


async def _for(seconds: float | None, plant: Path) -> None:
    async with asyncio.timeout(seconds):
        await run_plant(plant, Said(json=False))


def _usual_or_any() -> str:
    """The usual place, or any port of this machine where another program has that one."""
    host, port = split_address(USUAL)
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((host, port))
        except OSError:
            return f"{host}:0"
    return USUAL
