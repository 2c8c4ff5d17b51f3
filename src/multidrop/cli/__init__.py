"""The command line: thin, one file a group of commands."""

from __future__ import annotations


def main() -> None:
    """Entry point of the `multidrop` command."""
    from multidrop.cli.main import run

    raise SystemExit(run())
