"""Profiles as TOML and as tables: nothing is lost on the way, and what is wrong is said with its place."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.catalog import load_profile, profile_names
from multidrop.errors import UsageError
from multidrop.points import Role
from multidrop.profile import PointDescription, Profile
from multidrop.tools.profiles.table import csv_text, decoded, from_csv
from multidrop.tools.profiles.text import point_line, toml_text, with_points

TEXT = st.text("aB1.5,;|\\'=+-@# {}[]é€" + '"', max_size=6)
WORD = TEXT.map(str.strip).filter(bool)
NUMBER = st.integers(-(10**9), 10**9) | st.floats(allow_nan=False, allow_infinity=False)
ITEM = WORD.filter(lambda text: not text.endswith("\\"))


def points(text: st.SearchStrategy[str]) -> st.SearchStrategy[PointDescription]:
    return st.builds(
        PointDescription,
        name=WORD,
        at=WORD,
        role=st.sampled_from(Role),
        meaning=text,
        unit=st.none() | WORD,
        scale=NUMBER.filter(bool),
        minimum=st.none() | NUMBER,
        maximum=st.none() | NUMBER,
        default=st.none() | NUMBER | text.filter(bool),
        access=st.sampled_from(("r", "w", "rw")),
        note=text,
        derived=st.booleans(),
        type=st.none() | WORD,
        length=st.none() | st.integers(0, 64),
        excluded=st.lists(NUMBER, max_size=3),
        names=st.dictionaries(st.integers(-9, 99).map(str), ITEM, max_size=3),
        bits=st.lists(st.just("") | ITEM, max_size=4).filter(lambda bits: not bits or bool(bits[-1])),
        functions=st.text("0123456789AB", max_size=6),
        refusals=st.lists(st.integers(0, 255), max_size=3),
    )  # fmt: skip


def profiles(text: st.SearchStrategy[str]) -> st.SearchStrategy[Profile]:
    return st.builds(
        Profile,
        name=WORD,
        protocol=WORD,
        title=text,
        dialect=st.none() | WORD,
        baud=st.none() | st.integers(50, 115200),
        format=st.none() | st.sampled_from(("8E1", "7O1", "8N1")),
        inferred=st.dictionaries(st.sampled_from("pqr"), st.integers(0, 9999), max_size=2),
        bases=st.dictionaries(st.sampled_from("BLC"), st.integers(0, 0xFFFF), max_size=2),
        notes=text,
        version=text,
        points=st.lists(points(text), max_size=3, unique_by=lambda item: item.name).map(
            lambda found: {item.name: item for item in found}
        ),
    )


@pytest.mark.parametrize("name", profile_names())
def test_every_shipped_profile_comes_back(name: str) -> None:
    profile = load_profile(name)
    assert Profile.from_toml(toml_text(profile, "two\nlines"), name) == profile
    for semicolons in (False, True):
        table = csv_text(profile, semicolons=semicolons)
        assert from_csv(table, name) == profile
        assert from_csv(decoded(table.encode("utf-8-sig"), name), name) == profile


@given(profiles(st.text("aé\\\n\r\t\x7f\x00\u2028" + '"', max_size=6)))
def test_any_profile_comes_back_from_toml(profile: Profile) -> None:
    assert Profile.from_toml(toml_text(profile), "x.toml") == profile


@given(profiles(TEXT), st.booleans())
def test_any_profile_comes_back_from_a_table(profile: Profile, semicolons: bool) -> None:
    assert from_csv(csv_text(profile, semicolons=semicolons), "x.csv") == profile


@given(st.binary(max_size=300))
def test_no_file_makes_it_fail_in_another_way(data: bytes) -> None:
    head = b"profile.name;x\nprofile.protocol;slink3\nname;at;scale;bits;names;default\n"
    for content in (data, head + data):
        with contextlib.suppress(UsageError):
            from_csv(decoded(content, "x.csv"), "x.csv")


# -- what spreadsheets write -------------------------------------------------------------------

GERMAN = (
    "profile.name;Presse\r\nprofile.protocol;slink3\r\nprofile.dialect;flexmax\r\n;;;\r\n"
    "Name;AT;Role;Unit;Scale;Minimum;derived;;\r\n"
    "Vorschub;8236:int16;setting;m/min;0,1;-12,5;FALSCH;meine Notiz;\r\n"
    ";;;;;;;;\r\n"
    "Kühlung;8237;;°C;;;WAHR;;\r\n"
)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_a_list_that_a_german_spreadsheet_saved(encoding: str) -> None:
    profile = from_csv(decoded(GERMAN.encode(encoding), "x.csv"), "x.csv")
    assert (profile.name, profile.dialect) == ("Presse", "flexmax")
    feed, cooling = profile.points.values()
    assert (feed.scale, feed.minimum, feed.role) == (0.1, -12.5, Role.SETTING)
    assert (cooling.name, cooling.unit, cooling.derived) == ("Kühlung", "°C", True)


def test_tabs_and_a_told_delimiter() -> None:
    tabs = GERMAN.replace(";", "\t")
    assert from_csv(tabs, "x.csv") == from_csv(GERMAN, "x.csv")
    assert from_csv(f"sep=;\r\n{GERMAN}", "x.csv") == from_csv(GERMAN, "x.csv")


def test_what_a_spreadsheet_would_spoil_is_marked() -> None:
    point = PointDescription("x", "8236.10", functions="0123", meaning="=1+1", default="5")
    profile = Profile("p", "slink3", format="8E1", points={"x": point})
    table = csv_text(profile)
    for marked in ("'8E1", "'8236.10", "'0123", "'=1+1", "'5"):
        assert f",{marked}" in table
    assert from_csv(table, "x.csv") == profile


HEAD = "profile.name,p\nprofile.protocol,slink3\n\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "x.csv: no row has the headings"),
        ("name,unit\na,b\n", "x.csv: no row has the headings 'name' and 'at'"),
        ("name,at\na,1\n", "x.csv: profile.name is not said"),
        ("profile.nam,p\nname,at\n", "row 1: 'profile.nam' is neither profile.KEY nor a heading - did you mean 'name'?"),
        (HEAD + "name,at,scale\n", ""),
        (HEAD + "name,at,scal\n", "row 4, column C: unknown heading 'scal'"),
        (HEAD + "name,at,scal\na,1,2\n", "row 4, column C: unknown heading 'scal' - did you mean 'scale'?"),
        (HEAD + "name,at,at\na,1,2\n", "row 4, column C: there are two columns 'at'"),
        (HEAD + "name,at,scale\na,1,fast\n", "row 5, column C (scale): 'fast' is not a number"),
        (HEAD + "name,at,scale\na,1,٢\n", "row 5, column C (scale): '٢' is not a number"),
        (HEAD + "name,at,scale\na,1,1_5\n", "row 5, column C (scale): '1_5' is not a number"),
        (HEAD + 'name,at,scale\na,1,"0,1"\n', "row 5, column C (scale): '0,1' has a comma"),
        (HEAD + "name,at,scale\na,1,1.000.000\n", "row 5, column C (scale): '1.000.000' is not a number: no marks"),
        (HEAD + "name,at,scale\na,1,0\n", "row 5.scale must not be 0"),
        (HEAD + "name,at,length\na,1,1.5\n", "row 5, column C (length): '1.5' is not a whole number"),
        (HEAD + "name,at,derived\na,1,maybe\n", "row 5, column C (derived): 'maybe' is neither yes nor no"),
        (HEAD + "name,at,role\na,1,sets\n", "row 5.role 'sets' is none of: setting"),
        (HEAD + "name,at,names\na,1,off\n", "row 5, column C (names): 'off' is not of the form raw=name"),
        (HEAD + "name,at\n,1\n", "row 5: it has no name"),
        (HEAD + "name,at\na,\n", "row 5.at is missing"),
        (HEAD + "name,at\na,1\n\na,2\n", "row 7: row 5 has the name 'a' too"),
        ("profile.baud,fast\nname,at\n", "row 1, column B (baud): 'fast' is not a number"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place(text: str, said: str) -> None:
    if not said:
        assert from_csv(text, "x.csv").points == {}
        return
    with pytest.raises(UsageError) as raised:
        from_csv(text, "x.csv")
    assert str(raised.value).startswith("x.csv: ")
    assert said in str(raised.value)


def test_a_column_far_right_has_two_letters() -> None:
    with pytest.raises(UsageError, match="column AB: unknown heading 'zzz'"):
        from_csv(HEAD + "name,at" + "," * 25 + ",zzz\na,1\n", "x.csv")


def test_what_is_no_text_is_said_to_be_none() -> None:
    with pytest.raises(UsageError, match=r"x\.csv: no text"):
        decoded(b"PK\x03\x04\0\0\x81", "x.csv")


# -- a point into a file -----------------------------------------------------------------------

OWN = """# our own list
[profile]
name = "press"
protocol = "slink3"   # a drive

[points]
# the first
feed = { at = "8236:int16", role = "setting" }
index_9000 = { at = "9000:int16" }  # which?

[points.long]
at = "8300:int16"
"""


def named(name: str, at: str) -> dict[str, PointDescription]:
    return {name: PointDescription(name, at, Role.SETTING, unit="rpm")}


def test_a_point_is_added_and_comments_stay() -> None:
    text = with_points(OWN, "press.toml", named("speed", "8237:int16"), {})
    assert "# the first" in text
    assert "# a drive" in text
    assert list(Profile.from_toml(text, "x").points) == ["feed", "index_9000", "speed", "long"]


def test_a_point_takes_the_place_of_another() -> None:
    text = with_points(OWN, "press.toml", named("speed", "9000:int16"), {"speed": "index_9000"})
    assert "# the first" in text
    assert "index_9000" not in text
    assert "  # which?" in text
    assert Profile.from_toml(text, "x").points["speed"].unit == "rpm"


def test_a_point_with_a_table_of_its_own_is_replaced_too() -> None:
    text = with_points(OWN, "press.toml", named("ramp", "8300:int16"), {"ramp": "long"})
    assert list(Profile.from_toml(text, "x").points) == ["feed", "index_9000", "ramp"]


@pytest.mark.parametrize("text", [OWN.partition("[points]")[0], toml_text(Profile("p", "slink3"))])
def test_a_profile_without_points_gets_its_first(text: str) -> None:
    text = with_points(text, "x.toml", named("speed", "8237"), {})
    assert list(Profile.from_toml(text, "x").points) == ["speed"]


def test_a_name_that_is_taken_is_refused() -> None:
    with pytest.raises(
        UsageError, match=r"press\.toml: points\.feed: there is a point of this name"
    ):
        with_points(OWN, "press.toml", named("feed", "9000:int16"), {"feed": "index_9000"})
    same = with_points(OWN, "press.toml", named("feed", "8236:int16"), {"feed": "feed"})
    assert Profile.from_toml(same, "x").points["feed"].unit == "rpm"


@given(profiles(TEXT), points(TEXT))
def test_any_point_can_be_added(profile: Profile, point: PointDescription) -> None:
    if point.name in profile.points:
        return
    text = with_points(toml_text(profile), "x.toml", {point.name: point}, {})
    added: dict[str, Any] = {**profile.points, point.name: point}
    assert Profile.from_toml(text, "x.toml") == replace(profile, points=added)


def test_a_point_is_one_line() -> None:
    assert point_line(PointDescription("ä b", "1", unit="°C", names={"0": "x"})) == (
        '"ä b" = { at = "1", unit = "°C", names = { 0 = "x" } }'
    )
