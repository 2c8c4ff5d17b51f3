"""What a person can get wrong on the command line: refused, with what is allowed."""

from __future__ import annotations

import pytest

from multidrop.cli.main import COMMANDS
from unit.cli.conftest import CommandLine

PORT = "tcp://127.0.0.1:1"  # nobody listens there: a refusal that comes too late is exit 5
PTY = ("--listen", "pty")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(command_line: CommandLine, name: str) -> None:
    status, out, err = command_line(name, "--help")
    assert (status, err) == (0, "")
    assert f"Example: multidrop {name}" in " ".join(out.split())


def test_help(command_line: CommandLine) -> None:
    status, out, _ = command_line("--help")
    assert status == 0
    for name in COMMANDS:
        assert f"  {name} " in out
    assert "not a safety function" in out
    assert command_line("-h") == (status, out, "")


def test_nothing_asked(command_line: CommandLine) -> None:
    status, out, err = command_line()
    assert status in (0, 2)
    assert "Commands:" in out + err


def test_the_version(command_line: CommandLine) -> None:
    status, out, _ = command_line("--version")
    assert status == 0
    assert out.startswith("multidrop ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("raed",), "there is no command 'raed' - did you mean 'read'"),
        (("reset", "flexmax:0@x"), "which reset? multidrop clear-faults"),
        (("read",), "Missing argument 'DEVICE'"),
        (("read", f"flexmax:0@{PORT}"), "which points?"),
        (("write", f"flexmax:0@{PORT}"), "Missing argument 'POINT=VALUE"),
        (("read", f"flexmax:0@{PORT}", "8236", "--evry", "1"), "--every"),
        (("read", f"flexmax:0@{PORT}", "8236", "--every", "soon"), "not a valid float"),
        (("read", f"flexmax:0@{PORT}", "8236", "--every", "-1"), "not in the range"),
        (("read", f"flexmax:0@{PORT}", "8236", "--every", "٢"), "not a valid float"),
        (("read", f"flexmax:0@{PORT}", "8236", "--every", "1_5"), "not a valid float"),
        (("read", f"flexmax:0@{PORT}", "8236", "--every", "nan"), "'nan' is not a valid float"),
        (("read", f"flexmax:0@{PORT}", "8236", "--every", "inf"), "not in the range"),
        (("watch", f"flexmax:0@{PORT}", "8236", "--every", "1e300"), "not in the range"),
        (("watch-drift", "none.toml", "--every", "nan"), "'nan' is not a valid float"),
        (("sniff", PORT, "--seconds", "nan"), "'nan' is not a valid float"),
        (("demo", "--listen", "nope"), "'nope' is not of the form tcp://HOST:PORT"),
        (("demo", "--http", "nope"), "--http 'nope' is not HOST:PORT"),
        (("demo", "--http", "0.0.0.0:8080"), "for this machine alone"),
        (("demo", "--seconds", "1e300"), "not in the range"),
        (("simulate", "flexmax:2", *PTY, "--delay", "nan"), "'nan' is not a valid float"),
        (("read", f"flexmax:0@{PORT}", "8236", "--baud", "٩600"), "baud='٩600' is not a number"),
        (("read", f"flexmax:0@{PORT}", "٨٢٣٦"), "is not a point: [DEST/]INDEX"),
        (("write", f"flexmax:0@{PORT}", "8236:int16=٢"), "not a whole number, decimal or 0x hex"),
        (("read", f"flexmax:٢@{PORT}", "8236"), "is not a device: PROFILE:ADDRESS"),
        (("read", "flexmax:0@tcp://127.0.0.1:٤٠٠١", "8236"), "Port could not be cast"),
        (("broadcast", f"flexmax@{PORT}", "8236:int16=1", "--verify", "٢"), "--verify"),
        (("scan", PORT, "--baud", "٩600"), "not a valid integer"),
        (("scan", PORT, "--addresses", "٢..31"), "are not of the form 0..31"),
        (("scan", PORT, "--addresses", "0b1"), "are not of the form 0..31"),
        (("doctor", PORT, "--times", "٢"), "not a valid integer"),
        (("simulate", "flexmax:٢", *PTY), "is not a device"),
        (("simulate", "flexmax:2", *PTY, "--fault", "noise=٢%"), "is not of the form noise=5%"),
        (("sniff", PORT, "--device-profile", "٢=ax-v"), "is not ADDRESS=PROFILE"),
        (("read", f"flexmax:0@{PORT}", "8236", "--yes=1"), "does not take a value"),
        (("doctor",), "Missing argument"),
        (("doctor", PORT, "--protocol", "modbus"), "there is no protocol 'modbus'"),
        (
            ("doctor", PORT, "--protocol", "datalink", "--addresses", "40"),
            "none of these addresses",
        ),
        (("doctor", PORT, "--seconds", "-1"), "seconds=-1 is out of range: 0..86400"),
        (("doctor", PORT, "--times", "0"), "times=0 is out of range: 1..10000"),
        (("doctor", PORT, "/dev/other"), "one port at a time"),
        (("doctor", f"{PORT},settle=x,bad=1"), "unknown key 'bad'"),
        (("doctor", f"flexmax:0@{PORT}", "flexmax:1@/dev/x"), "is not on the line of"),
        (("doctor", f"flexmax:0@{PORT}", "--protocol", "datalink"), "speaks slink3, not datalink"),
    ],
)
def test_commands_and_options(
    command_line: CommandLine, arguments: tuple[str, ...], message: str
) -> None:
    status, out, err = command_line(*arguments)
    assert (status, out) == (2, "")
    assert message in err


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ("flexmax:0", "is looked up in multidrop.toml, and there is none here"),
        ("flexmax@/dev/x", "'flexmax@/dev/x' is not a device: PROFILE:ADDRESS@PORT"),
        ("flexmax:@/dev/x", "is not a device"),
        ("flexmax:x@/dev/x", "is not a device"),
        ("flexmax:0@", "is not a device"),
        ("@/dev/x", "is not a device"),
        ("flexmax:-1@/dev/x", "is not a device"),
        (f"flexmax:128@{PORT}", "0..127"),
        (f"flexmx:0@{PORT}", "there is no profile 'flexmx' - did you mean 'flexmax'"),
        (f"flexmax:0@{PORT},boud=9600", "unknown key 'boud' - did you mean 'baud'"),
        (f"flexmax:0@{PORT},stuffing=on", "unknown key 'stuffing'"),
        (f"flexmax:0@{PORT},baud", "'baud' is not key=value"),
        (f"flexmax:0@{PORT},baud=fast", "baud='fast' is not a number"),
        (f"flexmax:0@{PORT},baud=10", "baud rate 10 is out of range: 50..4000000"),
        (f"flexmax:0@{PORT},format=9E1", "format '9E1' is not of the form 8E1"),
        (f"flexmax:0@{PORT},timeout=0", "timeout=0 s is out of range"),
        (f"flexmax:0@{PORT},timeout=61", "timeout=61 s is out of range"),
        (f"flexmax:0@{PORT},timeout=nan", "timeout="),
        (f"flexmax:0@{PORT},silence=-1", "silence=-1 s is out of range"),
        (f"flexmax:0@{PORT},attempts=0", "attempts=0: at least 1"),
        (f"flexmax:0@{PORT},attempts=1.5", "attempts='1.5' is not a number"),
        (f"flexmax:0@{PORT},echo=maybe", "echo='maybe' is none of auto, on, off"),
        (f"flexmax:0@{PORT},rts=high", "rts='high' is none of on, off, leave"),
        (f"flexmax:0@{PORT},direction=rts", "direction='rts' is none of auto, kernel"),
        (f"flexmax:0@{PORT},broadcast=5", "broadcast='5' is out of range: 128..255"),
        ("flexmax:0@tcp://host", "is not of the form tcp://HOST:PORT"),
        ("flexmax:0@tcp://host:x", "tcp://host:x"),
        ("flexmax:0@rfc2217://host", "is not of the form rfc2217://HOST:PORT"),
    ],
)
def test_devices_and_keys(command_line: CommandLine, device: str, message: str) -> None:
    status, out, err = command_line("read", device, "8236:int16")
    assert (status, out) == (2, "")
    assert message in err
    assert len(err.splitlines()) <= 2


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (("--baud", "x"), "baud='x' is not a number"),
        (("--format", "8X1"), "format '8X1'"),
        (("--echo", "x"), "echo='x' is none of"),
        (("--stuffing", "on"), "unknown key 'stuffing'"),
        (("--broadcast", "0"), "broadcast='0' is out of range"),
        (("--profile", "none.toml"), "none.toml: No such file"),
        (("--config", "none.toml"), "none.toml: No such file"),
    ],
)
def test_keys_as_options(command_line: CommandLine, option: tuple[str, ...], message: str) -> None:
    status, _, err = command_line("read", f"flexmax:0@{PORT}", "8236", *option)
    assert status == 2
    assert message in err


@pytest.mark.parametrize(
    ("device", "point", "message"),
    [
        ("flexmax:0", "8236:int17", "'int17' is no type - did you mean 'int16'"),
        ("flexmax:0", "65536:int16", "index 65536 of '65536:int16' is out of range: 0..65535"),
        ("flexmax:0", "1.256:int16", "subindex 256"),
        ("flexmax:0", "dest8/1:int16", "dest1..dest7"),
        ("flexmax:0", "card/1:int16", "'card' is no destination of flexmax"),
        ("flexmax:0", "std/0x6099.0", "needs a type"),
        ("flexmax:0", "actual_sped", "did you mean 'actual_speed'"),
        ("flexmax:0", "8236:bool", "flexmax has no type bool"),
        ("flexmax:0", "8236:", "is not a point"),
        ("flexmax:0", "", "is not a point"),
        ("ax-v:0", "1009.1:int16", "ax-v has no subindex"),
        ("ax-v:0", "1009:string", "ax-v has no type string"),
    ],
)
def test_points(command_line: CommandLine, device: str, point: str, message: str) -> None:
    status, out, err = command_line("read", f"{device}@{PORT}", point)
    assert (status, out) == (2, "")
    assert message in err


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("8236", "'8236' is not POINT=VALUE"),
        ("=5", "is not POINT=VALUE"),
        ("8236:int16=", "is not a whole number"),
        ("8236:int16=x", "8236:int16: 'x' is not a whole number, decimal or 0x hex"),
        ("8236:int16=1.5", "is not a whole number"),
        ("8236:int16=32768", "32768 does not fit int16: -32768..32767"),
        ("8236:uint16=-1", "-1 does not fit uint16"),
        ("8236:float32=1e99", "does not fit float32"),
        ("8236:string=" + "x" * 245, "245 characters are too many: at most 244"),
        ("8236:string=\u20ac", "is not a Latin-1 character"),
        ("address=128", "128 is out of range for address: 0..127"),
        ("actual_speed=1", "is read-only in profile flexmax; --force writes it"),
        ("p44:int16=1", "by an inferred rule, so it is read-only"),
    ],
)
def test_values(command_line: CommandLine, assignment: str, message: str) -> None:
    status, out, err = command_line("write", f"flexmax:0@{PORT}", assignment)
    assert (status, out) == (2, "")
    assert message in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("raw", f"flexmax:0@{PORT}", "xx"), "is not hex bytes"),
        (("raw", f"flexmax:0@{PORT}", "23"), "at least the two bytes of COMMAND"),
        (("raw", f"flexmax:0@{PORT}", "card/2300"), "no destination"),
        (("status", f"ax-v:0@{PORT}"), "ax-v has no status word"),
        (("clear-faults", f"dgfc386:0@{PORT}"), "dgfc386 has no command that clears faults"),
        (("reset-comm", f"ax-v:0@{PORT}"), "ax-v has no reset of its serial interface"),
        (("broadcast", f"flexmax:0@{PORT}", "8236:int16=1", "--verify", "0"), "no address"),
        (("broadcast", f"flexmax@{PORT}", "8236:int16=1"), "--verify"),
        (("broadcast", f"flexmax@{PORT}", "8236:int16=1", "--verify", "0,128"), "0..127"),
        (
            ("broadcast", f"flexmax@{PORT}", "dgfc/511:uint8=1", "--verify", "0"),
            "hears no broadcast",
        ),
        (("broadcast", f"flexmax@{PORT}", "1=1", "--verify", "0"), "needs a type"),
        (("broadcast", f"flexmax@{PORT}", "address=1", "--verify", "0"), "--force"),
        (
            ("write", f"flexmax:0@{PORT}", "speed_setpoint=1", "8300:int16=99999"),
            "8300:int16: 99999 does not fit int16",
        ),
        (("points", "nothing"), "there is no profile 'nothing'"),
        (("simulate", "flexmax:0"), "--listen"),
    ],
)
def test_services(command_line: CommandLine, arguments: tuple[str, ...], message: str) -> None:
    status, out, err = command_line(*arguments)
    assert (status, out) == (2, "")
    assert message in err


def test_a_refusal_comes_before_the_port_is_opened(command_line: CommandLine) -> None:
    """The proof that the refusals above come in time: without them it is the port's turn."""
    for arguments in (
        ("read", f"flexmax:0@{PORT}", "8236:int16"),
        ("write", f"flexmax:0@{PORT}", "8236:int16=1"),
        ("broadcast", f"flexmax@{PORT}", "8236:int16=1", "--verify", "0"),
        ("raw", f"flexmax:0@{PORT}", "2300"),
        ("status", f"flexmax:0@{PORT}"),
        ("watch", f"flexmax:0@{PORT}", "8236:int16"),
    ):
        status, _, err = command_line(*arguments)
        assert status == 5, arguments
        assert f"cannot open {PORT}: connection refused" in err
