"""The text of a passport: what is written is read again, and nonsense is refused with its place."""

from __future__ import annotations

import time
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.errors import UsageError
from multidrop.passports.difference import Difference, differences
from multidrop.passports.passport import Entry, Passport, Unread
from multidrop.points import Role

NOW = datetime(2026, 11, 22, 2, 31, 7, tzinfo=UTC)
KP = Entry("0x011", "kp", Role.SETTING, 4.0, None, "uint16", "0200")
SPEED = Entry("0x06D", "setpoint_velocity", Role.SETPOINT, 1.5, "counts/s", "uint32", "00000018")
HOT = Entry("0x108", "drive_temperature", Role.MEASURED, 31.5, "%", "int16", "0FC0")
LOST = Unread("0x09E", "gain", Role.SETTING, "refused with code 0003h: no")


def passport(
    *points: Entry, unread: tuple[Unread, ...] = (), profile: str = "ultra3000"
) -> Passport:
    return Passport(
        "ultra3000:0@/dev/ttyUSB0", profile, "1", 0, 38400, "8N1", NOW, "0.1.0",
        {item.point: item for item in points}, {item.point: item for item in unread},
    )  # fmt: skip


TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
ENTRIES = st.builds(
    Entry,
    TEXT,
    st.none() | TEXT,
    st.sampled_from(Role),
    st.booleans() | st.integers(-(2**63), 2**63) | st.floats() | TEXT,
    st.none() | TEXT,
    TEXT.filter(lambda text: text != "bytes"),
    TEXT,
)
BYTES = st.builds(
    Entry, TEXT, st.none() | TEXT, st.sampled_from(Role), st.binary(), st.none(), st.just("bytes"), TEXT
)  # fmt: skip


@given(st.lists(ENTRIES | BYTES, unique_by=lambda item: item.point), TEXT)
def test_what_is_written_is_read_again(entries: list[Entry], reason: str) -> None:
    made = passport(*entries, unread=(Unread(reason, None, Role.UNKNOWN, reason),))
    again = Passport.from_text(made.to_text(), "x.toml")
    assert repr(again) == repr(made)  # repr: NaN is not equal to itself
    assert again.to_text() == made.to_text()


def test_one_line_a_point_so_that_version_control_shows_one_change() -> None:
    before = passport(KP, SPEED, HOT).to_text().splitlines()
    after = passport(Entry("0x011", "kp", Role.SETTING, 5.0, None, "uint16", "0280"), SPEED, HOT)
    changed = [
        new for old, new in zip(before, after.to_text().splitlines(), strict=True) if old != new
    ]
    assert len(changed) == 2
    assert changed[0].startswith('"0x011" = { name = "kp", role = "setting", value = 5.0')
    assert changed[1].startswith("sha256 = ")


def test_a_file_that_passed_through_another_systems_line_ends_is_the_same() -> None:
    text = passport(KP).to_text().replace("\n", "\r\n")
    assert Passport.from_text(text, "x.toml") == passport(KP)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("passport = 1\n", "", "no passport: it does not begin with passport = 1"),
        ("passport = 1", "passport = 2", "a passport of format 2; this multidrop reads format 1"),
        ("value = 4.0", "value = ", "no passport: "),
        ("sha256 = ", "sha257 = ", "the checksum at the end is missing"),
        ("address = 0", "address = true", "address is missing or no whole number"),
        ("baud = 38400\n", "", "baud is missing or no whole number"),
        ("time = 2026-11-22T02:31:07Z", "time = 3", "time is missing or no time"),
        ("time = 2026-11-22T02:31:07Z", "time = 2026-11-22T02:31:07", "time has no zone: it ends in Z"),
        ("value = 4.0", "value = " + "9" * 5000, "no passport: "),
        ("value = 4.0", "value = " + "[" * 100_000, "no passport: it is nested too deeply"),
        ("passport = 1", "passport = 1\nowner = 3", "unknown key 'owner'"),
        ('role = "setting"', 'role = "secret"', "points.0x011.role 'secret' is none of: setting"),
        ('raw = "0200"', "raw = 200", "points.0x011.raw is missing or not text"),
        (', raw = "0200"', "", "points.0x011.raw is missing or not text"),
        ("value = 4.0, ", "", "points.0x011.value is missing or no value"),
        ("value = 4.0", "value = [4]", "points.0x011.value is missing or no value"),
        ('type = "uint16"', 'typ = "uint16"', "points.0x011: unknown key 'typ' - did you mean 'type'"),
        ('type = "uint16"', 'type = "bytes"', "points.0x011.value 4.0 is not hex"),
        ('"0x011" = {', '"0x012" = 3\n"0x011" = {', "points.0x012 is not a table in one line"),
        ("[unreadable]", "[unreadable]\nx = { reason = 3 }", "unreadable.x.reason is missing or not"),
        ("[points]", "[pointz]", "unknown key 'pointz' - did you mean 'points'"),
    ],
)  # fmt: skip
def test_nonsense_is_refused_with_its_place(old: str, new: str, why: str) -> None:
    text = passport(KP).to_text()
    assert old in text
    with pytest.raises(UsageError) as refused:
        Passport.from_text(text.replace(old, new, 1), "x.toml", damaged=True)
    assert str(refused.value).startswith("x.toml: ")
    assert why in str(refused.value)


def test_points_that_are_no_table() -> None:
    text = (
        passport()
        .to_text()
        .replace("[points]\n", "")
        .replace("passport = 1", "passport = 1\npoints = 3")
    )
    with pytest.raises(UsageError, match="points is not a table"):
        Passport.from_text(text, "x.toml", damaged=True)


def test_a_changed_value_is_found_by_the_checksum_unless_somebody_says_so() -> None:
    text = passport(KP).to_text().replace("value = 4.0", "value = 4.5")
    with pytest.raises(UsageError, match="its checksum does not fit its content"):
        Passport.from_text(text, "x.toml")
    assert Passport.from_text(text, "x.toml", damaged=True).points["0x011"].value == 4.5


def test_every_file_cut_short_is_refused() -> None:
    text = passport(KP, SPEED).to_text()
    for size in range(len(text) - 1):
        for damaged in (False, True):
            with pytest.raises(UsageError):
                Passport.from_text(text[:size], "x.toml", damaged=damaged)


# -- differences ------------------------------------------------------------------------------


def found(before: Passport, after: Passport, *, everything: bool = False) -> list[Difference]:
    return list(differences(before, after, everything=everything))


def test_all_indices_of_a_drive_are_compared_in_a_moment() -> None:
    points = [replace(KP, point=str(index)) for index in range(65536)]
    started = time.process_time()
    changed = replace(points[-1], value=5.0)
    (only,) = found(passport(*points), passport(*points[:-1], changed))
    assert only.point == "65535"
    assert time.process_time() - started < 10


def test_the_same_has_no_differences() -> None:
    assert found(passport(KP, SPEED, unread=(LOST,)), passport(KP, SPEED, unread=(LOST,))) == []


def test_a_value_that_was_edited_differs_though_its_raw_is_the_same() -> None:
    edited = replace(KP, value=5.0)
    assert found(passport(edited), passport(KP)) == [Difference("0x011", "kp", edited, KP)]


def test_values_that_are_no_numbers_are_the_same_and_equal_raw_has_one_unit() -> None:
    gain = Entry("9001", "gain", Role.SETTING, float("nan"), None, "float32", "0000C07F")
    assert found(passport(gain), passport(replace(gain, value=float("nan")))) == []
    assert found(passport(KP), passport(replace(KP, unit="1/s"))) == []


def test_measured_points_are_never_compared_and_setpoints_on_request() -> None:
    hotter = Entry("0x108", "drive_temperature", Role.MEASURED, 33.0, "%", "int16", "1080")
    faster = Entry(
        "0x06D", "setpoint_velocity", Role.SETPOINT, 2.0, "counts/s", "uint32", "00000020"
    )
    before, after = passport(KP, SPEED, HOT), passport(KP, faster, hotter)
    assert found(before, after) == []
    assert found(before, after, everything=True) == [
        Difference("0x06D", "setpoint_velocity", SPEED, faster)
    ]


def test_a_point_that_only_one_side_has_or_could_read() -> None:
    gain = Entry("0x09E", "gain", Role.SETTING, 1, None, "uint8", "01")
    assert found(passport(KP), passport(gain)) == [
        Difference("0x011", "kp", KP, None),
        Difference("0x09E", "gain", None, gain),
    ]
    assert found(passport(unread=(LOST,)), passport(gain)) == [
        Difference("0x09E", "gain", LOST, gain)
    ]


def test_another_type_with_the_same_value_is_no_difference() -> None:
    wide = Entry("0x011", "kp", Role.SETTING, 4.0, None, "uint32", "00000200")
    assert found(passport(KP), passport(wide)) == []


def test_two_models_cannot_be_compared() -> None:
    with pytest.raises(
        UsageError, match=r"of profile ultra3000, .* of flexmax: their points cannot"
    ):
        found(passport(KP), passport(profile="flexmax"))
