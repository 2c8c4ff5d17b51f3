"""What the errors say to a person."""

from __future__ import annotations

import pytest

from multidrop import errors


def test_the_tree() -> None:
    """Everything that is raised on purpose is one of these, and nothing else is."""
    assert {kind.__name__ for kind in errors.Error.__subclasses__()} == {
        "UsageError",
        "DeviceError",
        "NoReply",
        "ProtocolError",
        "OutcomeUnknown",
        "NotApplied",
        "PortError",
    }


@pytest.mark.parametrize(
    ("error", "kind", "status"),
    [
        (errors.Error, "failure", 1),
        (errors.UsageError, "usage", 2),
        (errors.DeviceError, "refused", 3),
        (errors.NoReply, "no-reply", 4),
        (errors.PortError, "port", 5),
        (errors.ProtocolError, "protocol", 6),
        (errors.OutcomeUnknown, "unknown-outcome", 7),
        (errors.NotApplied, "not-applied", 8),
    ],
)
def test_what_programs_know_an_error_by(error: type[errors.Error], kind: str, status: int) -> None:
    assert (error.kind, error.exit_status) == (kind, status)


def test_each_error_has_its_own_kind_and_status() -> None:
    """1 is a bug, 130 an interruption."""
    every = errors.Error.__subclasses__()
    assert len({error.kind for error in every} | {"failure"}) == len(every) + 1
    assert len({error.exit_status for error in every} | {0, 1, 130}) == len(every) + 3


def test_a_refusal_shows_its_code_in_hex() -> None:
    refusal = errors.DeviceError(0x12, "above the maximum", fault=True)
    assert str(refusal) == "refused with code 0012h: above the maximum"
    assert (refusal.code, refusal.meaning, refusal.fault) == (0x12, "above the maximum", True)


@pytest.mark.parametrize(
    ("failure", "text"),
    [
        (errors.NoReply(1), "no reply in 1 attempt"),
        (errors.NoReply(3), "no reply in 3 attempts"),
        (errors.NoReply(0, because="the line was busy"), "the line was busy in 0 attempts"),
        (
            errors.NoReply(2, damaged=(b"\x01\x02",), heard=(b"\x03",)),
            "no reply in 2 attempts; damaged bytes came: 01 02;"
            " frames that were not the answer came: 03",
        ),
    ],
)
def test_no_reply_says_what_came_instead(failure: errors.NoReply, text: str) -> None:
    assert str(failure) == text


def test_a_protocol_error_shows_the_bytes_where_there_are_some() -> None:
    assert str(errors.ProtocolError("too short", b"\xab\x01")) == "too short (bytes AB 01)"
    assert str(errors.ProtocolError("too short")) == "too short"


def test_what_a_lost_write_carries() -> None:
    assert errors.OutcomeUnknown("gone", step="the answer").step == "the answer"
    assert errors.NotApplied("still 5", found=5).found == 5


def test_many_and_long_bytes_are_shortened() -> None:
    assert errors.shown((b"\x01", b"\x02", b"\x03")) == "01 | 02 | 03"
    assert errors.shown((b"\x01",) * 5) == "01 | 01 | 01 | and 2 more"
    assert errors.shown((bytes(32),)) == " ".join(["00"] * 32)
    assert errors.shown((bytes(33),)) == " ".join(["00"] * 32) + " ..."
