"""Profiles of one's own: found by name, listed with their place, as tables for spreadsheets."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from multidrop.catalog import load_profile, profile_names
from multidrop.errors import UsageError
from unit.cli.conftest import CommandLine

PRESS = """
[profile]
name = "press"
protocol = "slink3"
dialect = "flexmax"
[points]
feed = { at = "8236:int16" }
"""


@pytest.fixture(autouse=True)
def _own_configuration(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("MULTIDROP_CONFIG", raising=False)


def put(path: Path, text: str = PRESS) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def listed(command_line: CommandLine, *arguments: str) -> dict[str, str | None]:
    status, out, _ = command_line("profiles", "--json", *arguments)
    assert status == 0
    return {item["name"]: item["place"] for item in map(json.loads, out.splitlines())}


def test_shipped_profiles_have_no_place_of_their_own(command_line: CommandLine) -> None:
    assert listed(command_line) == dict.fromkeys(profile_names())
    assert " shipped" in command_line("profiles")[1]


def test_the_users_configuration(command_line: CommandLine, tmp_path: Path) -> None:
    path = put(tmp_path / "config" / "multidrop" / "profiles" / "press.toml")
    assert listed(command_line)["press"] == str(path)
    assert command_line("points", "press")[0] == 0


@pytest.mark.parametrize(("plant", "folder"), [("", "profiles"), ('profiles = "ours"\n', "ours")])
def test_beside_the_plant_file(
    command_line: CommandLine, tmp_path: Path, plant: str, folder: str
) -> None:
    (tmp_path / "multidrop.toml").write_text(
        f'{plant}[line.a]\nport = "tcp://127.0.0.1:1"\n[line.a.device.one]\nprofile = "press"\naddress = 1\n'
    )
    path = put(tmp_path / folder / "press.toml")
    assert listed(command_line)["press"] == f"{folder}/press.toml"
    assert load_profile("press") == load_profile(str(path))
    assert command_line("read", "one", "feed")[0] == 5  # known, and nobody is there


def test_beside_a_plant_file_elsewhere(command_line: CommandLine, tmp_path: Path) -> None:
    there = tmp_path / "site"
    put(there / "profiles" / "press.toml")
    plant = there / "plant.toml"
    plant.write_text("")
    assert "press" not in listed(command_line)
    assert listed(command_line, "--config", str(plant))["press"]
    device = "press:1@tcp://127.0.0.1:1"
    assert command_line("read", device, "feed")[0] == 2
    assert command_line("read", device, "feed", "--config", str(plant))[0] == 5


def test_what_cannot_be_used_is_said(command_line: CommandLine, tmp_path: Path) -> None:
    folder = tmp_path / "config" / "multidrop" / "profiles"
    put(folder / "flexmax.toml", PRESS.replace("press", "flexmax"))
    put(folder / "other.toml")
    put(folder / "wrong.toml", PRESS.replace("8236:int16", "8236:int99"))
    _, out, err = command_line("profiles")
    assert "press" not in out
    assert (
        f"not used: {folder}/flexmax.toml: the name is that of a profile that multidrop ships"
        in err
    )
    assert f"{folder}/other.toml: profile.name is 'press'" in err
    assert f"{folder}/wrong.toml: points.feed: '8236:int99': 'int99' is no type" in err
    assert len(load_profile("flexmax").points) > 1, "the shipped one"
    with pytest.raises(UsageError, match="give both one name"):
        load_profile("other")


def test_an_unknown_name_says_where_it_was_looked_for(
    command_line: CommandLine, tmp_path: Path
) -> None:
    put(tmp_path / "config" / "multidrop" / "profiles" / "press.toml")
    status, _, err = command_line("points", "pres")
    assert status == 2
    assert "did you mean 'press'?" in err
    assert f"looked for pres.toml in {tmp_path}/config/multidrop/profiles" in err
    assert command_line("points", "../press")[0] == 2


def test_a_folder_that_is_no_name(command_line: CommandLine, tmp_path: Path) -> None:
    (tmp_path / "multidrop.toml").write_text("profiles = 3\n")
    status, _, err = command_line("profiles")
    assert (status, "multidrop.toml: profiles is 3" in err) == (2, True)


# -- tables ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", profile_names())
@pytest.mark.parametrize("more", [(), ("--semicolons",)])
def test_out_to_a_spreadsheet_and_back(
    command_line: CommandLine, tmp_path: Path, name: str, more: tuple[str, ...]
) -> None:
    assert command_line("profiles", "export", name, "-o", "a.csv", *more)[0] == 0
    assert (tmp_path / "a.csv").read_bytes().startswith(b"\xef\xbb\xbfprofile.name")
    assert command_line("profiles", "import", "a.csv", "-o", "a.toml")[0] == 0
    assert load_profile("a.toml") == load_profile(name)
    assert command_line("profiles", "export", "a.toml", "-o", "b.toml")[0] == 0
    assert load_profile("b.toml") == load_profile(name)


def test_a_bare_list_is_like_a_profile(command_line: CommandLine, tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text("name,at\nfeed,8236:int16\n")
    refused = command_line("profiles", "import", "list.csv", "-o", "press.toml")
    assert (refused[0], "profile.protocol is not said" in refused[2]) == (2, True)
    like = ("--like", "flexmax")
    assert command_line("profiles", "import", "list.csv", "-o", "press.toml", *like)[0] == 0
    found = load_profile("press.toml")
    assert (found.name, found.dialect, found.inferred) == ("press", "flexmax", {"p": 8192})
    assert list(found.points) == ["feed"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("export", "flexmax", "-o", "x.xls"), "is exported as .csv or .toml"),
        (("export", "flexmx", "-o", "x.csv"), "did you mean 'flexmax'?"),
        (("export", "flexmax", "-o", "here.csv"), "here.csv is there already; --force replaces it"),
        (("export", "flexmax", "-o", "nowhere/x.csv"), "there is no folder nowhere"),
        (("import", "here.csv", "-o", "x.csv"), "a profile's file ends in .toml"),
        (("import", "none.csv", "-o", "x.toml"), "none.csv: No such file"),
        (("import", "here.csv", "-o", "x.toml"), "here.csv: no row has the headings"),
        (("import", "at.csv", "-o", "x.toml", "--like", "flexmax"), "at.csv: points.a: point a: at = 'zz' is not"),
        (("import", "protocol.csv", "-o", "x.toml"), "profile.protocol 'slink' - did you mean 'slink3'?"),
    ],
)  # fmt: skip
def test_what_is_refused(
    command_line: CommandLine, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    (tmp_path / "here.csv").write_text("nothing\n")
    (tmp_path / "at.csv").write_text("name,at\na,zz\n")
    (tmp_path / "protocol.csv").write_text("profile.protocol,slink\nname,at\n")
    status, out, err = command_line("profiles", *arguments)
    assert (status, out) == (2, "")
    assert said in err
    assert not (tmp_path / "x.toml").exists()
