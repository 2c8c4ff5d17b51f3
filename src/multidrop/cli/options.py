"""What most commands share: the device, the keys of its line, --json, --trace, --capture, --yes."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from multidrop.catalog import CONFIG, CONFIG_ENVIRONMENT, load_profile, profile_file
from multidrop.cli import flags
from multidrop.cli.log import CommandLog
from multidrop.errors import UsageError
from multidrop.io.audit import AuditLog
from multidrop.io.connection import Connection, Target, connect
from multidrop.io.line import Line, Tap
from multidrop.naming import DeviceName, parse_device
from multidrop.profile import Profile

if TYPE_CHECKING:
    from multidrop.plantfile import Plant, PlantDevice

CommandT = TypeVar("CommandT", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Common:
    """The shared options as given."""

    json: bool
    trace: bool
    yes: bool
    force: bool
    keys: dict[str, str]
    profile: str | None
    config: str | None
    capture: str | None = None

    def target(self, device: str, *, broadcast: bool = False) -> Target:
        """The device of a name. Raises `UsageError`."""
        if "@" not in device and not broadcast:
            found = self.plant().find(device)
            return self._plant_target(found)
        name = parse_device(device, broadcast=broadcast)
        name = _with_keys(name, self.keys)
        return Target(name, self.profile_of(name))

    def profile_of(self, name: DeviceName) -> Profile:
        """The profile of a device's name, or the one of --profile. Raises `UsageError`."""
        if self.profile:
            return profile_file(Path(self.profile))
        return load_profile(name.profile, self.plant_path())

    def plant_device(self, device: str) -> PlantDevice | None:
        """What the plant file says of a device named by it; None for one named by its address."""
        return None if "@" in device else self.plant().find(device)

    def plant(self) -> Plant:
        from multidrop.plantfile import load_plant

        path = self.plant_path()
        if not path.exists() and self.config is None:
            raise UsageError(
                f"a name without @ is looked up in {path}, and there is none here; "
                "a device is PROFILE:ADDRESS@PORT, as in flexmax:0@/dev/ttyUSB0"
            )
        return load_plant(path, functools.partial(load_profile, config=path))

    def plant_path(self) -> Path:
        """The plant file, whether or not there is one. Raises `UsageError` where it was named."""
        if self.config is not None and not Path(self.config).exists():
            raise UsageError(f"{self.config}: No such file or directory")
        return Path(self.config or os.environ.get(CONFIG_ENVIRONMENT, CONFIG))

    def _plant_target(self, found: PlantDevice) -> Target:
        return Target(_with_keys(found.device, self.keys), found.profile)

    def audit(self) -> AuditLog:
        """The log of writes. What it could not take is an `OSError` at the command's end."""
        log = CommandLog(origin="command line", force=self.force)
        click.get_current_context().call_on_close(log.demand_whole)
        return log

    def connect(self, target: Target) -> Connection:
        """Open the device's line, with a trace and a capture on it if those were asked for."""
        connection = connect(target, audit=self.audit())
        self.watch(connection.line, target)
        return connection

    def watch(self, line: Line, target: Target) -> None:
        """Put a trace and a capture on a line if asked for. Raises `UsageError`, the line closed."""
        try:
            self.tap(line.taps, target)
        except UsageError:
            line.close()
            raise

    def tap(self, taps: list[Tap], target: Target) -> None:
        """The same for the taps of any line, which stays as it is."""
        if self.trace:
            from multidrop.cli.trace import Trace

            trace = Trace(target.protocol, target.settings.decoder, sys.stderr)
            taps.append(trace)
            click.get_current_context().call_on_close(trace.finish)
        if self.capture:
            from multidrop.cli.capturing import capture_to

            capture_to(taps, target, self.capture, self._known_on(target))

    def _known_on(self, target: Target) -> list[PlantDevice]:
        """The devices that the plant file has on the same port."""
        path = self.plant_path()
        if not path.exists():
            return []
        plant = self.plant()
        return [device for device in plant.devices.values() if device.device.port == target.port]

    def confirm(self, question: str, *, needs_yes: bool) -> None:
        """Ask where somebody can answer; elsewhere go on, or demand --yes. Raises `UsageError`."""
        if self.yes:
            return
        if sys.stdin.isatty() and sys.stderr.isatty():
            if not click.confirm(question, err=True):
                raise UsageError("not confirmed; nothing was sent")
        elif needs_yes:
            raise UsageError(f"{question} Nobody is there to answer: --yes says so.")


def _with_keys(name: Any, keys: dict[str, str]) -> Any:
    from dataclasses import replace

    return replace(name, options={**name.options, **keys})


def common(*, force: str = "", writes: bool = False) -> Callable[[CommandT], CommandT]:
    """Gives a command `common: Common`. `force` is the help of its --force, if it has one."""

    def decorate(command: CommandT) -> CommandT:
        @functools.wraps(command)
        def wrapper(**given: Any) -> Any:
            keys = flags.taken_keys(given)
            options = Common(
                json=given.pop("json"),
                trace=given.pop("trace"),
                yes=given.pop("yes"),
                force=given.pop("force", False),
                keys=keys,
                profile=given.pop("profile"),
                config=given.pop("config"),
                capture=given.pop("capture"),
            )
            return command(common=options, **given)

        return _decorated(wrapper, force, writes)  # type: ignore[no-any-return]

    return decorate


def _decorated(command: Any, force: str, writes: bool) -> Any:
    command = flags.config(flags.line_keys(command))
    command = click.option("--profile", metavar="FILE", help="a profile of your own, TOML")(command)
    command = flags.as_json(flags.trace(flags.capture(command)))
    if force:
        command = click.option("--force", is_flag=True, help=force)(command)
    return click.option("--yes", is_flag=True, help="ask no questions", hidden=not writes)(command)
