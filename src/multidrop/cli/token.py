"""`multidrop token`: a token with which somebody may read, or write, over HTTP."""

from __future__ import annotations

from pathlib import Path

import click

from multidrop.gateway.web.tokens import Right, make_token


@click.command(
    epilog="Example: multidrop token control-room --write -o tokens.toml, and in multidrop.toml: "
    '[http] tokens = "tokens.toml"'
)
@click.argument("name")
@click.option("--write", is_flag=True, help="it may write too, what the plant file lets be written")
@click.option("-o", "--output", metavar="FILE", default="tokens.toml", help="file of the tokens")
def token(name: str, write: bool, output: str) -> None:
    """Make a token for NAME and print it: only now, for the file has its hash alone.

    NAME stands in the audit log. To take a token back, take its table out of the file;
    that counts at once.
    """
    path = Path(output)
    rights = [Right.READ, Right.WRITE] if write else [Right.READ]
    secret = make_token(path, name, rights)
    click.echo(secret)
    click.echo(f"{path} has its hash, and lets it {' and '.join(rights)}", err=True)
