"""The gateway's tables, and the page that has every key."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import pytest

from multidrop import plantfile
from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.gateway.settings import (
    CLASSES,
    FaultSettings,
    HttpSettings,
    Settings,
    settings_of,
    survey_settings,
)
from multidrop.naming import LINE_KEYS
from multidrop.plantfile import Plant, parse_plant
from multidrop.protocols import PROTOCOLS

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "configuration.md"


def plant(text: str) -> Plant:
    return parse_plant(text, "/etc/site/plant.toml", load_profile)


def test_a_part_is_on_where_its_table_stands() -> None:
    settings = settings_of(plant('[http]\nlisten = "0.0.0.0:80"\nnames = ["gw"]\n[faults]\n'))
    assert settings.http == HttpSettings(listen="0.0.0.0:80", names=("gw",))
    assert settings.faults == FaultSettings()
    assert (settings.history, settings.mqtt, settings.modbus) == (None, None, None)
    assert settings_of(plant("")) == Settings(Path("/etc/site"))


def test_paths_are_relative_to_the_plant_file() -> None:
    settings = settings_of(plant(""))
    assert settings.path("history.db") == Path("/etc/site/history.db")
    assert settings.path("/var/lib/history.db") == Path("/var/lib/history.db")
    assert settings.path("~/h.db") == Path.home() / "h.db"


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("[http]\nlistn = 1", "http: unknown key 'listn' - did you mean 'listen'?"),
        ("[http]\nlisten = 80", "http.listen is 80, which is not a text"),
        ("[http]\nnames = 'a'", "http.names is 'a', which is not a list of texts"),
        ("[http]\nnames = [1]", "http.names is [1], which is not a list of texts"),
        ("http = 1", "http is not a table"),
        ("[mqtt]", "mqtt.host is missing: the broker"),
        ("[mqtt]\nhost = 'a'\nport = true", "mqtt.port is True, which is not a whole number"),
        ("[mqtt]\nhost = 'a'\nport = 1.5", "mqtt.port is 1.5, which is not a whole number"),
        ("[mqtt]\nhost = 'a'\nport = 0", "mqtt.port is 0, which is not a whole number of 1 or"),
        ("[mqtt]\nhost = 'a'\ntls = 1", "mqtt.tls is 1, which is not true or false"),
        ("[history]\nkeep = -1", "history.keep is -1, which is not a number of 0 or more"),
        ("[history]\nkeep = nan", "history.keep is nan, which is not a number of 0 or more"),
        ("[faults]\nkeep = 0", "faults.keep is 0, which is not a whole number of 1 or more"),
    ],
)
def test_what_is_wrong_is_named(text: str, wrong: str) -> None:
    with pytest.raises(UsageError) as refused:
        settings_of(plant(text))
    assert f"/etc/site/plant.toml: {wrong}" in str(refused.value)


def test_all_that_is_wrong_is_said_and_what_is_right_is_there() -> None:
    found = survey_settings(plant("[http]\na = 1\nb = 2\n[mqtt]\n[faults]\nkeep = 7\n"))
    assert len(found.wrong) == 3
    assert (found.http, found.mqtt, found.faults) == (None, None, FaultSettings(keep=7))


def test_every_table_is_one_that_a_plant_file_may_have() -> None:
    assert set(plantfile.TABLES) == set(CLASSES) <= {item.name for item in fields(Settings)}


def keys_of(heading: str) -> set[str]:
    """The keys in the first column of the table below a heading of the page."""
    text = PAGE.read_text(encoding="utf-8")
    section = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.M)
    assert section is not None
    rows = re.findall(r"^\| (`.*?) \|", section[1], re.M)
    return {key for row in rows for key in re.findall(r"`(\w+)`", row)}


@pytest.mark.parametrize("table", CLASSES)
def test_the_page_has_every_key_of_a_table(table: str) -> None:
    assert keys_of(f"[{table}]") == {item.name for item in fields(CLASSES[table])}


def test_the_page_has_every_key_of_a_line_a_device_and_a_point() -> None:
    own = {key for protocol in PROTOCOLS.values() for key in protocol.options}
    assert keys_of("[line.NAME]") == {"port", *LINE_KEYS, *own}
    assert keys_of("[line.NAME.device.NAME]") == set(plantfile.DEVICE_KEYS)
    assert keys_of("[line.NAME.device.NAME.points]") == set(plantfile.POINT_KEYS)
