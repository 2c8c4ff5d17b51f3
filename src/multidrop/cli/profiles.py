"""`multidrop profiles`, `profiles export`, `profiles import`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from multidrop.catalog import check_points, load_profile, own_files, profile_file, profile_names
from multidrop.cli.about import print_table
from multidrop.cli.flags import as_json
from multidrop.cli.words import json_line
from multidrop.errors import UsageError
from multidrop.profile import Profile, nearest
from multidrop.protocols import PROTOCOLS

_config = click.option(
    "--config", metavar="FILE", help="the plant file, beside which profiles are found"
)


@click.group(
    invoke_without_command=True,
    epilog="Example: multidrop profiles; multidrop profiles export ultra3000 -o ultra3000.csv",
)
@as_json
@_config
@click.pass_context
def profiles(ctx: click.Context, json: bool, config: str | None) -> None:
    """List the device models that multidrop knows, and where their profiles are."""
    if ctx.invoked_subcommand is not None:
        return
    found = list(_all(Path(config) if config else None))
    if json:
        for profile, place in found:
            facts = {"name": profile.name, "title": profile.title, "protocol": profile.protocol}
            line = {**facts, "points": len(profile.points), "place": place}
            click.echo(json_line(line))
        return
    rows = [
        (item.name, item.title, item.protocol, str(len(item.points)), place or "shipped")
        for item, place in found
    ]
    print_table(("profile", "model", "protocol", "points", "place"), rows)


def _all(config: Path | None) -> Iterator[tuple[Profile, str | None]]:
    """Each profile, and its file if it is the user's own. What cannot be used is said."""
    for name in profile_names():
        yield load_profile(name), None
    for own in own_files(config):
        if own.problem:
            click.secho(f"not used: {_with_path(own.path, own.problem)}", err=True, fg="yellow")
        else:
            yield profile_file(own.path), str(own.path)


def _with_path(path: Path, problem: str) -> str:
    return problem if problem.startswith(str(path)) else f"{path}: {problem}"


@profiles.command(
    "export", epilog="Example: multidrop profiles export ultra3000 -o ultra3000.csv --semicolons"
)
@click.argument("profile")
@click.option("-o", "--output", required=True, metavar="FILE", help="a .csv or .toml file")
@click.option("--semicolons", is_flag=True, help="cells between semicolons, decimal commas")
@click.option("--force", is_flag=True, help="replace FILE")
@_config
def export_profile(
    profile: str, output: str, semicolons: bool, force: bool, config: str | None
) -> None:
    """Write PROFILE as a table for spreadsheets, or as TOML to start one of your own from."""
    from multidrop.io.text_file import check_place, write_whole
    from multidrop.tools.profiles.table import csv_text
    from multidrop.tools.profiles.text import toml_text

    path = Path(output)
    if path.suffix not in (".csv", ".toml"):
        raise UsageError(f"{output}: a profile is exported as .csv or .toml")
    found = load_profile(profile, Path(config) if config else None)
    check_place(path, force=force)
    if path.suffix == ".toml":
        write_whole(toml_text(found), path)
    else:  # with the mark by which spreadsheets know UTF-8
        write_whole(csv_text(found, semicolons=semicolons), path, "utf-8-sig")
    click.echo(f"{path}: {len(found.points)} points of {found.name}", err=True)


@profiles.command(
    "import", epilog="Example: multidrop profiles import list.csv -o press.toml --like flexmax"
)
@click.argument("file", metavar="FILE.csv")
@click.option("-o", "--output", required=True, metavar="NAME.toml", help="the profile")
@click.option(
    "--like", metavar="PROFILE", help="protocol, dialect and line settings are those of PROFILE"
)
@click.option("--force", is_flag=True, help="replace NAME.toml")
@_config
def import_profile(
    file: str, output: str, like: str | None, force: bool, config: str | None
) -> None:
    """Read a table that a spreadsheet saved, and write it as a profile."""
    from multidrop.io.text_file import check_place, write_whole
    from multidrop.tools.profiles.table import decoded, from_csv
    from multidrop.tools.profiles.text import said, toml_text

    path = Path(output)
    if path.suffix != ".toml":
        raise UsageError(f"{output}: a profile's file ends in .toml")
    defaults: dict[str, Any] = {}
    if like is not None:
        model = load_profile(like, Path(config) if config else None)
        kept = ("protocol", "dialect", "baud", "format", "inferred", "bases")
        defaults = {key: value for key, value in said(model).items() if key in kept}
    check_place(path, force=force)
    try:
        data = Path(file).read_bytes()
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from None
    found = from_csv(decoded(data, file), file, {"name": path.stem, **defaults})
    if found.protocol not in PROTOCOLS:
        near = nearest(found.protocol, PROTOCOLS)
        raise UsageError(
            f"{file}: profile.protocol {found.protocol!r}{near} is none of {', '.join(PROTOCOLS)}"
        )
    check_points(found, file)
    write_whole(toml_text(found, f"From {Path(file).name}"), path)
    click.echo(f"{path}: {len(found.points)} points", err=True)


__all__ = ["profiles"]
