"""What an instrument says of itself."""

from __future__ import annotations

from datalink_wire import Instrument, response, steps_of

from multidrop.catalog import load_profile
from multidrop.device import Report
from multidrop.protocols.datalink.device import device


def status_of(profile: str, **bits: int) -> tuple[Report, Instrument]:
    instrument = Instrument()
    instrument.memory[0x1450:0x145A] = b"FIC-101\0\0\0"
    instrument.memory[0x1B6C:0x1B80] = b"53MC5112B1      XYZ "
    for name, value in bits.items():
        number = int(name[1:])
        instrument.memory[0x500 + number // 8] |= value << number % 8
    one = device(3, load_profile(profile), {})
    report: Report = instrument.run(one.status())
    return report, instrument


def test_a_controller_with_four_loops() -> None:
    report, instrument = status_of(
        "53mc5000", L107=1, L110=1, L132=1, L152=1, L153=1, L183=1, L384=1, L399=1, L65=1
    )
    fields = report.fields
    assert (fields["map"], fields["tag"], fields["model"]) == (
        "A",
        "FIC-101",
        "53MC5112B1      XYZ",
    )
    assert fields["fault"] is None
    assert fields["status_word"] is None
    assert fields["loops"][0] == {
        "loop": 0,
        "automatic": True,
        "remote": False,
        "setpoint_tracked": False,
        "output_tracked": False,
        "alarms": ["loop0_alarm_a"],
    }
    assert fields["loops"][1]["remote"] is True
    assert fields["alarms"] == ["loop0_alarm_a", "loop3_alarm_b"]
    assert fields["unacknowledged"] == [
        "status0_point0_unacknowledged",
        "status1_point7_unacknowledged",
    ]
    assert fields["horn"] is True
    assert report.lines == (
        "map                A",
        "tag                FIC-101",
        "model              53MC5112B1      XYZ",
        "loop 0             automatic, local setpoint, in alarm",
        "loop 1             manual, remote setpoint",
        "loop 2             manual, local setpoint, setpoint tracked, output tracked",
        "loop 3             manual, local setpoint, in alarm",
        "alarm              loop0_alarm_a",
        "alarm              loop3_alarm_b",
        "not acknowledged   status0_point0_unacknowledged",
        "not acknowledged   status1_point7_unacknowledged",
        "horn               on",
    )
    # map, bits of horn and loops, bits to acknowledge, tag, model
    assert len(instrument.messages) == 5


def test_a_quiet_indicator_has_alarms_and_no_modes() -> None:
    report, _ = status_of("53it5100")
    assert report.fields["loops"][3] == {
        "loop": 3,
        "automatic": None,
        "remote": None,
        "setpoint_tracked": None,
        "output_tracked": None,
        "alarms": [],
    }
    assert report.fields["alarms"] == []
    assert report.fields["horn"] is None
    assert report.lines[3:] == tuple(f"loop {loop}             no alarm" for loop in range(4))


def test_an_instrument_without_a_profile_has_tag_and_model() -> None:
    report, instrument = status_of("datalink", L107=1)
    assert report.fields["loops"] == []
    assert report.fields["unacknowledged"] == []
    assert len(report.lines) == 3
    assert len(instrument.messages) == 3


def test_map_b_says_only_that_it_answers() -> None:
    one = device(3, load_profile("53sl6000"), {})
    steps, report = steps_of(one.status(), response(0x9CF, "00"))
    assert len(steps) == 1
    assert report.fields["map"] == "B"
    assert report.fields["fault"] is None
    assert report.lines[0] == "map                B"


def test_loops_in_automatic_are_running() -> None:
    instrument = Instrument()
    one = device(3, load_profile("53mc5000"), {})
    assert instrument.run(one.running()) is None
    instrument.memory[0x500 + 131 // 8] |= 1 << 131 % 8
    assert instrument.run(one.running()).startswith("in automatic: ")
    assert instrument.run(one.running()).endswith("(L131)")


def test_an_instrument_of_no_known_map_cannot_say_whether_it_runs() -> None:
    one = device(3, load_profile("53sl6000"), {})
    assert steps_of(one.running()) == ([], None)
