"""What a device refuses before a byte is sent; what it sends is in the dialogues."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.points import Role, Value
from multidrop.profile import PointDescription, Profile
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.slink3 import Frame
from multidrop.protocols.slink3.device import Slink3Device, device


def named(profile: str) -> Slink3Device:
    return device(1, load_profile(profile), {})


VOLTAGE = PointDescription(
    "voltage", "8300:uint16", Role.SETTING, unit="V", scale=0.1, minimum=0, maximum=20
)


def scaled() -> Slink3Device:
    profile = Profile("press", "slink3", dialect="flexmax", points={"voltage": VOLTAGE})
    return device(1, profile, {})


def test_a_profile_without_a_dialect_speaks_all_of_the_protocol() -> None:
    assert named("slink3").dialect.name == "slink3"
    assert named("flexmax").dialect.name == "flexmax"


def test_a_dialect_that_nobody_speaks() -> None:
    with pytest.raises(UsageError, match="profile x: dialect 'y' is none of slink3, flexmax"):
        device(1, Profile("x", "slink3", dialect="y"), {})


@pytest.mark.parametrize("text", ["128", "254", "255"])
def test_the_broadcast_address_is_settable(text: str) -> None:
    assert device(1, load_profile("flexmax"), {"broadcast": text}).dialect.broadcast == int(text)


@pytest.mark.parametrize("text", ["127", "256", "-1", "x", ""])
def test_broadcast_addresses_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match=r"is out of range: 128\.\.255"):
        device(1, load_profile("flexmax"), {"broadcast": text})


@pytest.mark.parametrize("address", [-1, 128])
def test_addresses_that_no_slave_has(address: int) -> None:
    with pytest.raises(UsageError, match="a slave has"):
        device(address, load_profile("flexmax"), {})


@pytest.mark.parametrize(
    ("make", "text", "value", "message"),
    [
        (lambda: named("flexmax"), "8236:int16", 32768, "32768 does not fit int16"),
        (lambda: named("flexmax"), "8236:int16", "x", "'x' is not a whole number"),
        (lambda: named("flexmax"), "status_word", 1, "read-only in profile flexmax; --force"),
        (lambda: named("flexmax"), "p100:int16", 1, "by an inferred rule, so it is read-only"),
        (lambda: named("flexmax"), "address", 128, "128 is out of range for address: 0..127"),
        (scaled, "voltage", 20.1, "20.1 V is out of range for voltage: 0..20 V"),
        (lambda: named("flexmax"), "8300:string", "x" * 245, "245 characters are too many"),
        (
            lambda: named("flexmax"),
            "8300.1:string",
            "x" * 244,
            r"244 characters are too many for 8300\.1: at most 243",
        ),
        (scaled, "voltage", "-1", "-1 V is out of range for voltage"),
        (scaled, "voltage", float("nan"), "nan is no value for voltage"),
    ],
)
def test_a_write_that_is_refused_before_it_is_sent(
    make: Callable[[], Slink3Device], text: str, value: Value, message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        make().prepare_write(text, value)


@pytest.mark.parametrize(
    ("make", "text", "value"),
    [
        (lambda: named("flexmax"), "status_word", 1),
        (lambda: named("flexmax"), "p100:int16", 1),
        (lambda: named("flexmax"), "address", 128),
        (lambda: named("flexmax"), "8300.1:string", "x" * 243),
        (lambda: named("flexmax"), "8300:string", "x" * 244),
        (lambda: named("flexmax"), "std/0x6050.1:bytes", b"x" * 244),
        (scaled, "voltage", 20.1),
    ],
)
def test_who_insists_may(make: Callable[[], Slink3Device], text: str, value: Value) -> None:
    assert make().prepare_write(text, value, force=True).value == value


def test_who_insists_still_cannot_say_what_does_not_fit() -> None:
    with pytest.raises(UsageError, match="65536 does not fit uint16"):
        scaled().prepare_write("voltage", 6553.6, force=True)


@pytest.mark.parametrize(("value", "asked"), [("12.3", 12.3), ("0x10", 16), (12.3, 12.3), (12, 12)])
def test_what_a_write_asks_for_is_physical(value: Value, asked: float) -> None:
    press = scaled()
    assert press.asked(press.prepare_write("voltage", value)) == asked


def test_what_a_write_without_a_type_asks_for_is_what_was_given() -> None:
    drive = named("flexmax")
    assert drive.asked(drive.prepare_write("8300", "12")) == "12"


def test_what_it_asks_for_is_known_once_a_read_has_shown_the_type() -> None:
    drive = named("flexmax")
    write = drive.prepare_write("8300", "12")
    reading = drive.read(drive.point("8300:int16"))
    next(reading)
    with pytest.raises(StopIteration):
        reading.send(Frame(1, order=1, data=b"\x03\x6c\x20\x00\x00"))
    assert drive.asked(write) == 12


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a command body has at least the two bytes"),
        ("23", "a command body has at least the two bytes"),
        ("2", "'2' is not hex bytes: COMMAND low, COMMAND high"),
        ("status", "'status' is not hex bytes"),
        ("dest9/23 00", "'dest9' is no destination of flexmax"),
        ("27 00" + " 00" * 248, "248 bytes of data are too many"),
    ],
)
def test_a_raw_command_that_cannot_be_sent(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        named("flexmax").prepare_raw(text)


@pytest.mark.parametrize(
    ("profile", "call", "message"),
    [
        ("ax-v", Slink3Device.status, "ax-v has no status word"),
        ("ax-v", Slink3Device.clear_faults, "ax-v has no command that clears faults"),
        ("dgfc386", Slink3Device.clear_faults, "dgfc386 has no command that clears faults"),
        ("ax-v", Slink3Device.reset_comm, "ax-v has no reset of its serial interface"),
    ],
)
def test_services_that_a_dialect_has_not(
    profile: str, call: Callable[[Slink3Device], Any], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        call(named(profile))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([("8236:int16", "40000")], "40000 does not fit int16"),
        ([("8236:int16", "1"), ("x", "1")], "has no point 'x'"),
        ([("8300", "1")], "8300 needs a type to be broadcast"),
        ([("8300:auto", "1")], "8300 needs a type to be broadcast"),
        ([("dgfc/511:uint8", "1")], "dgfc/511 is behind destination 2, which hears no broadcast"),
        ([("address", "1")], "role communication: every slave would act on it"),
        ([("control_word", "1")], "role command: every slave would act on it"),
    ],
)
def test_a_broadcast_that_is_refused_before_it_is_sent(
    points: list[tuple[str, str]], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        PROTOCOLS["slink3"].prepare_broadcast(load_profile("flexmax"), points, [0], {})
