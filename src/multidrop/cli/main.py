"""The `multidrop` command: finds a command's file, and turns what it raises into an exit status."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import click

from multidrop.cli import streams
from multidrop.cli.failures import INTERRUPTED, report_failure
from multidrop.errors import Error
from multidrop.io.audit import FULL

COMMANDS = {  # name -> (module, what it does); a module is imported when its command is called
    "demo": ("demo", "A simulated plant and its page: start here."),
    "ports": ("about", "The serial ports of this machine."),
    "profiles": ("profiles", "The device models that multidrop knows, and profiles as tables."),
    "points": ("about", "The points of a model."),
    "read": ("reading", "Read points of a device, once or again and again."),
    "write": ("writing", "Write points of a device and read them back."),
    "watch": ("watch", "A live table of points with their trend."),
    "status": ("services", "Status word, state, faults of a device."),
    "clear-faults": ("services", "Clear the fault of a drive."),
    "reset-comm": ("services", "Reset the serial interface of a slave, not its faults."),
    "broadcast": ("broadcast", "Write points of every slave at once, and verify."),
    "action": ("services", "Let a device do something at once: homing, a reset."),
    "save": ("memory", "Copy working values of a device into its non-volatile memory."),
    "load": ("memory", "Copy non-volatile values of a device back into use."),
    "compare-memory": ("memory", "What was changed and not saved, and what is not the default."),
    "backup": ("passports", "Every readable point of a device into a passport, a text file."),
    "diff": ("passports", "What two passports, or a passport and a device, do not agree on."),
    "restore": ("restore", "A passport's settings onto a device: first the plan, then the proof."),
    "discover": ("discover", "Which points a device has, found out with reads, as a profile."),
    "learn": ("learn", "Which point is it that is changed at the keypad? Gives it a name."),
    "watch-drift": ("watch_drift", "What was changed in a plant since its passports were made."),
    "raw": ("services", "Send one command body as is."),
    "scan": ("scan", "Which protocol, settings and addresses answer at a port."),
    "doctor": ("doctor", "Why a line fails, with the bytes that prove it."),
    "wireshark": ("wireshark", "The dissector and the extcap for Wireshark, and where they go."),
    "extcap": ("wireshark", "What Wireshark calls to listen to a line."),
    "sniff": ("sniff", "Listen to a line that others speak on, decoded and recorded."),
    "decode": ("decode", "Decode a capture into transactions."),
    "check": ("run", "What is wrong with a plant file, and how full its lines are."),
    "run": ("run", "Poll a plant as its file describes it, and serve what comes."),
    "token": ("token", "A token for the page and the HTTP interface of run."),
    "faults": ("faults", "What was kept of a device when it tripped."),
    "history": ("history", "What was recorded of a point, as CSV."),
    "share": ("share", "One port for many masters, over TCP."),
    "simulate": ("simulate", "Simulated devices on a TCP port or a pseudo-terminal."),
}
EXPLAINED = {  # what somebody may type, and what was meant
    "reset": (
        "multidrop clear-faults DEVICE clears a drive's fault; "
        "multidrop reset-comm DEVICE resets its serial interface and leaves faults alone."
    ),
}


class OutputGone(Exception):
    """Whoever read our output has gone; for click and rich that would be a failure of ours."""


class Commands(click.Group):
    """Imports only the command that is called: a read must start fast."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (BrokenPipeError, SystemExit) as gone:
            raise OutputGone from gone

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in EXPLAINED:
            raise click.UsageError(f"which reset? {EXPLAINED[cmd_name]}", ctx)
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"multidrop.cli.{COMMANDS[cmd_name][0]}")
        command: click.Command = getattr(module, cmd_name.replace("-", "_"))
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in COMMANDS and args[0] not in EXPLAINED:
            from multidrop.profile import nearest

            raise click.UsageError(
                f"there is no command {args[0]!r}{nearest(args[0], COMMANDS)}", ctx
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.command(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="A device is PROFILE:ADDRESS@PORT[,key=value]..., as in flexmax:0@/dev/ttyUSB0 or "
    "ax-v:2@tcp://10.0.0.7:4001, or the name of one in multidrop.toml. "
    "multidrop is not a safety function: stop and enable circuits are wired.",
)
@click.version_option(package_name="multidrop", message="multidrop %(version)s")
def cli() -> None:
    """Reads and writes decades-old drives and controllers on RS-485 lines."""


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; returns the exit status."""
    streams.prepare(sys.argv[1:] if arguments is None else arguments)
    color = False if os.environ.get("NO_COLOR") else None
    with click.Context(cli, color=color):  # for what is said when the command's own is gone
        return _run(arguments, color)


def _run(arguments: Sequence[str] | None, color: bool | None) -> int:
    try:
        result: Any = cli.main(arguments, prog_name="multidrop", standalone_mode=False, color=color)
        sys.stdout.flush()
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted", err=True)
        return INTERRUPTED
    except click.ClickException as error:
        error.show()
        if isinstance(error, click.MissingParameter) and error.ctx is not None:
            click.echo(error.ctx.command.epilog or "", err=True)
        return 2
    except (OutputGone, BrokenPipeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        click.secho(_of_system(error), err=True, fg="red")
        return 1
    except Error as error:
        report_failure(error)
        return error.exit_status
    return result if isinstance(result, int) else 0


def _of_system(error: OSError) -> str:
    """What the system said: of a file, of the disk under standard output, or of something else."""
    if error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return (
        f"the output could not be written: {error.strerror}" if error.errno in FULL else str(error)
    )
