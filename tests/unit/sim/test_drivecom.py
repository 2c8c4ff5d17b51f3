"""A simulated drive: states, control words, ramps, faults, by the clock that it is given."""

from __future__ import annotations

import pytest

from multidrop.protocols.slink3.status import State, state
from multidrop.sim.drivecom import COAST, QUICK_STOP_RAMP, RAMP, Drive

SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP, DISABLE, RESET = 0x06, 0x07, 0x0F, 0x02, 0x00, 0x80


def drive_in(wanted: State, now: float = 0.0) -> Drive:
    """A drive that was led to a state by control words alone."""
    ways = {
        State.SWITCH_ON_DISABLED: (),
        State.READY_TO_SWITCH_ON: (SHUTDOWN,),
        State.SWITCHED_ON: (SHUTDOWN, SWITCH_ON),
        State.OPERATION_ENABLED: (SHUTDOWN, SWITCH_ON, ENABLE),
    }
    drive = Drive()
    if wanted is State.QUICK_STOP_ACTIVE:
        drive = drive_in(State.OPERATION_ENABLED, now)
        drive.set_speed(1000, now)
        drive._speed = 1000.0
        drive.control(QUICK_STOP, now)
    elif wanted is State.FAULT:
        drive.trip(0x2310, now)
    else:
        for word in ways[wanted]:
            drive.control(word, now)
    assert drive.state is wanted
    return drive


@pytest.mark.parametrize(
    ("before", "word", "after"),
    [
        (State.SWITCH_ON_DISABLED, DISABLE, State.SWITCH_ON_DISABLED),
        (State.SWITCH_ON_DISABLED, SHUTDOWN, State.READY_TO_SWITCH_ON),
        (State.SWITCH_ON_DISABLED, SWITCH_ON, State.SWITCH_ON_DISABLED),
        (State.SWITCH_ON_DISABLED, ENABLE, State.SWITCH_ON_DISABLED),
        (State.READY_TO_SWITCH_ON, SWITCH_ON, State.SWITCHED_ON),
        (State.READY_TO_SWITCH_ON, ENABLE, State.SWITCHED_ON),
        (State.READY_TO_SWITCH_ON, SHUTDOWN, State.READY_TO_SWITCH_ON),
        (State.READY_TO_SWITCH_ON, QUICK_STOP, State.SWITCH_ON_DISABLED),
        (State.READY_TO_SWITCH_ON, DISABLE, State.SWITCH_ON_DISABLED),
        (State.SWITCHED_ON, ENABLE, State.OPERATION_ENABLED),
        (State.SWITCHED_ON, SHUTDOWN, State.READY_TO_SWITCH_ON),
        (State.SWITCHED_ON, QUICK_STOP, State.SWITCH_ON_DISABLED),
        (State.SWITCHED_ON, DISABLE, State.SWITCH_ON_DISABLED),
        (State.OPERATION_ENABLED, SWITCH_ON, State.SWITCHED_ON),
        (State.OPERATION_ENABLED, SHUTDOWN, State.READY_TO_SWITCH_ON),
        (State.OPERATION_ENABLED, QUICK_STOP, State.QUICK_STOP_ACTIVE),
        (State.OPERATION_ENABLED, DISABLE, State.SWITCH_ON_DISABLED),
        (State.QUICK_STOP_ACTIVE, ENABLE, State.OPERATION_ENABLED),
        (State.QUICK_STOP_ACTIVE, DISABLE, State.SWITCH_ON_DISABLED),
        (State.FAULT, ENABLE, State.FAULT),
        (State.FAULT, SHUTDOWN, State.FAULT),
        (State.FAULT, RESET, State.SWITCH_ON_DISABLED),
    ],
)
def test_control_words(before: State, word: int, after: State) -> None:
    drive = drive_in(before)
    drive.control(word, 0.0)
    assert drive.state is after


@pytest.mark.parametrize("where", [found for found in State if found is not State.UNDEFINED])
def test_the_status_word_says_the_state(where: State) -> None:
    drive = Drive()
    drive.set_speed(100, 0.0)
    drive.state = where
    drive._speed = 100.0  # a quick stop is over when the drive stands
    assert state(drive.status_word(0.0)) is where


def test_the_status_word_says_that_the_setpoint_is_reached_and_that_control_is_remote() -> None:
    drive = drive_in(State.OPERATION_ENABLED)
    assert drive.status_word(0.0) & 0x0200
    assert drive.status_word(0.0) & 0x0400  # standing still, as asked: set value reached
    drive.set_speed(100, 0.0)
    assert not drive.status_word(0.0) & 0x0400
    drive.remote = False
    assert not drive.status_word(0.0) & 0x0200


def test_the_speed_ramps_to_its_setpoint() -> None:
    drive = drive_in(State.OPERATION_ENABLED, now=10.0)
    drive.set_speed(1000, 10.0)
    assert drive.actual_speed(10.0) == 0
    assert drive.actual_speed(11.0) == RAMP
    assert drive.actual_speed(12.0) == 1000
    assert drive.actual_speed(99.0) == 1000
    assert drive.status_word(99.0) & 0x0400
    drive.set_speed(-500, 100.0)
    assert drive.actual_speed(101.0) == 1000 - RAMP
    assert drive.actual_speed(103.0) == -500


def test_a_drive_that_is_not_enabled_stands_still() -> None:
    drive = drive_in(State.SWITCHED_ON)
    drive.set_speed(1000, 0.0)
    assert drive.actual_speed(10.0) == 0


@pytest.mark.parametrize("word", [DISABLE, SHUTDOWN], ids=["disable voltage", "shutdown"])
def test_it_coasts_when_the_voltage_goes(word: int) -> None:
    drive = drive_in(State.OPERATION_ENABLED)
    drive.set_speed(1000, 0.0)
    drive.control(word, 10.0)
    assert drive.actual_speed(10.0) == 1000
    assert drive.actual_speed(12.0) == 1000 - 2 * COAST
    assert drive.actual_speed(30.0) == 0


def test_quick_stop_brakes_and_ends_switched_off() -> None:
    drive = drive_in(State.OPERATION_ENABLED)
    drive.set_speed(1000, 0.0)
    drive.control(QUICK_STOP, 10.0)
    assert drive.actual_speed(10.25) == 1000 - QUICK_STOP_RAMP * 0.25
    assert state(drive.status_word(10.25)) is State.QUICK_STOP_ACTIVE
    assert drive.actual_speed(10.5) == 0
    assert state(drive.status_word(10.5)) is State.SWITCH_ON_DISABLED


def test_a_trip_coasts_and_stays_until_it_is_reset() -> None:
    drive = drive_in(State.OPERATION_ENABLED)
    drive.set_speed(1000, 0.0)
    drive.trip(0x2310, 10.0)
    assert drive.in_fault
    assert drive.malfunction_code == 0x2310
    assert drive.actual_speed(11.0) == 1000 - COAST
    drive.control(RESET, 11.0)
    assert not drive.in_fault
    assert drive.malfunction_code == 0


def test_the_fault_reset_acts_on_its_rising_edge() -> None:
    drive = Drive()
    drive.control(RESET, 0.0)  # the bit is up before the fault comes
    drive.trip(0x3210, 1.0)
    drive.control(RESET, 2.0)
    assert drive.in_fault
    drive.control(0, 3.0)
    drive.control(RESET, 4.0)
    assert not drive.in_fault


def test_a_fault_whose_cause_is_there_cannot_be_cleared() -> None:
    drive = drive_in(State.FAULT)
    drive.cause_present = True
    drive.control(RESET, 0.0)
    assert drive.in_fault
    assert drive.malfunction_code == 0x2310


def test_time_does_not_run_backwards() -> None:
    drive = drive_in(State.OPERATION_ENABLED)
    drive.set_speed(1000, 0.0)
    assert drive.actual_speed(1.0) == RAMP
    assert drive.actual_speed(0.5) == RAMP
