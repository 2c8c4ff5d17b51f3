"""The command line: thin, one file a group of commands."""

from __future__ import annotations


def main() -> None:
    """Entry point of the `multidrop` command."""
    from multidrop.cli.ending import end_as_by_ctrl_c
    from multidrop.cli.main import run

    end_as_by_ctrl_c()
    raise SystemExit(run())
