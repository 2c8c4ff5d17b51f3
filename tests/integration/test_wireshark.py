"""The Wireshark dissector says of every packet what multidrop says of it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from integration.processes import multidrop
from integration.traffic import START_NS, write_traffic
from integration.tshark import INFO, LUA, dissected, tshark, tshark_path
from multidrop.device import ProtocolModule
from multidrop.errors import ProtocolError, UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.io.capture import CaptureWriter
from multidrop.io.captured import CaptureReader, Interface, Packet
from multidrop.observer import Found, Observer
from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000
from multidrop.protocols.slink3.messages import StandardParameter, TypedParameter
from multidrop.protocols.slink3.values import decode_value
from multidrop.transaction import Transaction

FRAMES = 10_000

Shown = dict[str, str]


def number(text: str) -> int | None:
    return int(text, 0) if text else None


def octets(text: str) -> bytes:
    return bytes.fromhex(text.replace(":", ""))


def truth(text: str) -> bool:
    return {"1": True, "True": True, "0": False, "False": False}[text]


# -- what each protocol's fields must be ----------------------------------------------------------


def slink3_agrees(raw: bytes, shown: Shown) -> Any:
    frame = slink3.Frame.decode(raw)
    assert number(shown["slink3.address"]) == frame.address
    assert number(shown["slink3.control"]) == frame.control
    assert number(shown["slink3.number"]) == frame.control >> 2
    assert number(shown["slink3.length"]) == len(raw)
    assert number(shown["slink3.order"]) == frame.order
    assert truth(shown["slink3.answer"]) == frame.is_answer
    assert truth(shown["slink3.fault"]) == frame.in_fault
    assert number(shown["slink3.destination"]) == frame.destination
    assert number(shown["slink3.code"]) == frame.code
    named = shown["slink3.response" if frame.is_answer else "slink3.command"]
    assert number(named) == frame.code
    assert octets(shown["slink3.data"]) == frame.data
    assert number(shown["slink3.checksum"]) == raw[-1]
    assert shown["slink3.checksum.status"] == "1"
    if not frame.is_answer:
        slink3_parameter_agrees(frame, shown)
    return frame


def slink3_parameter_agrees(frame: slink3.Frame, shown: Shown) -> None:
    typed = TypedParameter.decode(frame.data) if frame.code in (0x26, 0x27) else None
    standard = StandardParameter.decode(frame.data) if frame.code in (0x24, 0x25) else None
    found = typed or standard
    if found is None:
        assert shown["slink3.index"] == shown["slink3.value"] == ""
        return
    parameter, value = found
    assert number(shown["slink3.index"]) == parameter.index
    assert number(shown["slink3.subindex"]) == parameter.subindex
    assert octets(shown["slink3.value"]) == value
    if isinstance(parameter, TypedParameter):
        assert number(shown["slink3.type"]) == parameter.type_code
        if value:
            slink3_value_agrees(parameter.type_code, value, shown)


def slink3_value_agrees(type_code: int, raw: bytes, shown: Shown) -> None:
    try:
        value = decode_value(slink3.Format(type_code), raw)
    except (ProtocolError, ValueError):
        value = b""
    texts = [shown[f"slink3.value.{kind}"] for kind in ("integer", "float", "text")]
    if isinstance(value, float):
        assert float(texts[1]) == pytest.approx(value, rel=1e-6, nan_ok=True)
    elif isinstance(value, int):
        assert texts == [str(int(value)), "", ""]
    elif isinstance(value, str):
        assert texts == ["", "", repr(value)]
    else:
        assert texts == ["", "", ""]


def datalink_agrees(raw: bytes, shown: Shown) -> Any:
    frame = frame_of("datalink", raw)
    assert number(shown["datalink.command"]) == frame.command
    assert number(shown["datalink.address"]) == frame.address
    if frame.command is datalink.Command.ACKNOWLEDGE:
        assert shown["datalink.count"] == shown["datalink.lrc"] == ""
        return frame
    assert number(shown["datalink.memory_address"]) == frame.memory_address
    assert number(shown["datalink.count"]) == frame.count
    assert octets(shown["datalink.data"]) == frame.data
    plain = datalink.UnstuffedFrame(*frame).encode()
    assert number(shown["datalink.lrc"]) == plain[-1]
    assert shown["datalink.checksum.status"] == "1"
    assert (number(shown["datalink.inserted"]) or 0) == len(raw) - len(plain)
    return frame


def ultra3000_agrees(raw: bytes, shown: Shown) -> Any:
    frame = ultra3000.Frame.decode(raw)
    assert number(shown["ultra3000.address"]) == frame.address
    assert number(shown["ultra3000.parameter"]) == frame.parameter % 0x800
    assert truth(shown["ultra3000.refused"]) == frame.is_refusal
    assert number(shown["ultra3000.function"]) == frame.function
    assert shown["ultra3000.data"] == frame.data
    assert number(shown["ultra3000.checksum"]) == int(raw.strip()[-2:], 16)
    assert shown["ultra3000.checksum.status"] == "1"
    if frame.is_refusal and len(frame.data) == 2:
        assert number(shown["ultra3000.refusal"]) == int(frame.data, 16)
    if shown["ultra3000.value"]:
        assert number(shown["ultra3000.value"]) == int(frame.data, 16)
    return frame


AGREES = {"slink3": slink3_agrees, "datalink": datalink_agrees, "ultra3000": ultra3000_agrees}
OF_ALL = ["checksum", "checksum.status", "damage", "damaged"]
FIELDS = {
    "slink3": [
        *("address", "control", "number", "length", "order", "answer", "fault", "destination"),
        *("code", "command", "response", "data", "index", "subindex", "type", "value"),
        *("value.integer", "value.float", "value.text", *OF_ALL),
    ],
    "datalink": [
        *("address", "command", "memory_address", "count", "data", "lrc", "inserted", *OF_ALL[1:]),
    ],
    "ultra3000": [
        *("address", "parameter", "refused", "function", "data", "refusal", "value", *OF_ALL),
    ],
}
LINKS = [
    *(f"{name}.{link}" for name in FIELDS for link in ("request_in", "echo_of")),
    "datalink.acknowledges",
]
ASKED = [INFO, *(f"{name}.{field}" for name, fields in FIELDS.items() for field in fields), *LINKS]


@dataclass(frozen=True)
class Traffic:
    """The same packets as multidrop reads them, and as Wireshark shows them."""

    path: Path
    packets: list[Packet]
    interfaces: list[Interface]
    rows: list[Shown]

    def protocol(self, packet: Packet) -> ProtocolModule:
        found = self.interfaces[packet.interface].protocol
        assert found is not None
        return found


@pytest.fixture(scope="module")
def traffic(tmp_path_factory: pytest.TempPathFactory) -> Traffic:
    tshark_path()
    path = tmp_path_factory.mktemp("traffic") / "traffic.pcapng"
    write_traffic(path, FRAMES)
    reader = CaptureReader(path)
    packets = list(reader.packets())
    return Traffic(path, packets, reader.interfaces, dissected(path, ASKED, home=path.parent))


def frame_of(name: str, raw: bytes) -> Any:
    """The frame of these bytes, whether or not its line has byte stuffing."""
    try:
        return FRAME_TYPES[name].decode(raw)
    except UsageError:
        return datalink.UnstuffedFrame.decode(raw)


FRAME_TYPES: dict[str, Any] = {
    "slink3": slink3.Frame,
    "datalink": datalink.Frame,
    "ultra3000": ultra3000.Frame,
}


def test_of_10_000_frames_every_field_is_as_multidrop_decodes_it(traffic: Traffic) -> None:
    assert len(traffic.rows) == len(traffic.packets) >= FRAMES
    damaged = 0
    for packet, shown in zip(traffic.packets, traffic.rows, strict=True):
        protocol = traffic.protocol(packet)
        name = protocol.name
        if packet.damaged:
            damaged += 1
            assert shown[f"{name}.damage"] == packet.comment
            assert octets(shown[f"{name}.damaged"]) == packet.data
            assert shown[INFO] == f"! {packet.comment}"
        else:
            frame = AGREES[name](packet.data, shown)
            assert shown[f"{name}.damage"] == ""
            assert shown[INFO] == protocol.describe(frame).strip()
    assert FRAMES // 10 < damaged < FRAMES // 3


def test_the_10_000_frames_are_as_the_decode_command_prints_them(traffic: Traffic) -> None:
    ran = multidrop("decode", str(traffic.path), "--frames", "--json")
    assert ran.status == 0, ran.err
    compared = 0
    for known in ran.objects:
        packet, shown = traffic.packets[known["number"] - 1], traffic.rows[known["number"] - 1]
        name = known["protocol"]
        assert name == traffic.protocol(packet).name
        if packet.damaged:
            assert known["error"]["text"] == shown[f"{name}.damage"]
        else:
            compared += 1
            printed_agrees(name, known, shown)
    assert compared > 0.6 * FRAMES


def printed_agrees(name: str, known: dict[str, Any], shown: Shown) -> None:
    for field in FRAME_TYPES[name]._fields:
        value, text = known[field], shown[f"{name}.{field}"]
        if field == "parameter":
            assert value == (number(text) or 0) + 0x800 * truth(shown[f"{name}.refused"])
        elif isinstance(value, str):
            assert value == text.replace(" ", "")
        else:
            assert value == (number(text) or 0)  # an Acknowledge of Datalink has few fields


def test_the_10_000_frames_are_of_every_kind(traffic: Traffic) -> None:
    whole = [packet for packet in traffic.packets if not packet.damaged]
    frames: dict[str, list[Any]] = {name: [] for name in FIELDS}
    for packet in whole:
        name = traffic.protocol(packet).name
        frames[name].append(frame_of(name, packet.data))
    asked = {frame.code for frame in frames["slink3"] if not frame.is_answer}
    answered = {frame.code for frame in frames["slink3"] if frame.is_answer}
    assert asked >= set(slink3.Command)
    assert answered >= set(slink3.Response)
    assert {frame.command for frame in frames["datalink"]} == set(datalink.Command)
    assert {type(frame) for frame in frames["datalink"]} == {
        datalink.Frame,
        datalink.UnstuffedFrame,
    }
    functions = {frame.function for frame in frames["ultra3000"]}
    assert functions == set(range(16))
    refusals = {frame.data for frame in frames["ultra3000"] if frame.is_refusal}
    assert refusals >= {f"{code:02X}" for code in ultra3000.Refusal}


def test_questions_and_answers_of_10_000_frames_are_those_of_the_observer(traffic: Traffic) -> None:
    numbers = {id(packet.data): number for number, packet in enumerate(traffic.packets, 1)}
    observers: dict[int, Observer] = {}
    found: list[Found] = []
    for packet in traffic.packets:
        protocol = traffic.protocol(packet)
        observer = observers.setdefault(
            packet.interface, Observer(protocol, protocol.line, profiles={})
        )
        event = (
            Damaged(packet.data, packet.comment)
            if packet.damaged
            else FrameReceived(frame_of(protocol.name, packet.data), packet.data)
        )
        now = (packet.time_ns - START_NS) / 1e9
        found += observer.frame(event, now, packet.sent)
    for observer in observers.values():
        found += observer.finish()
    wanted: dict[int, int] = {}
    for item in found:
        if isinstance(item, Transaction):
            first, *others = (numbers[id(heard.raw)] for heard in item.frames)
            wanted |= dict.fromkeys(others, first)
    assert linked(traffic, "request_in", "acknowledges") == wanted
    assert len(wanted) > FRAMES // 10
    echoes = {
        numbers[id(item.echo.raw)]: numbers[id(item.frames[0].raw)]
        for item in found
        if isinstance(item, Transaction) and item.echo is not None
    }
    assert len(echoes) > FRAMES // 20
    shown = linked(traffic, "echo_of")
    assert echoes.items() <= shown.items()  # those of an Acknowledge belong to no question
    assert len(shown) == sum(observer.echoes for observer in observers.values())


def linked(traffic: Traffic, *links: str) -> dict[int, int]:
    """Number of each packet that has such a link -> where it leads."""
    names = [name for name in LINKS if name.partition(".")[2] in links]
    return {
        number: int(text)
        for number, shown in enumerate(traffic.rows, 1)
        if (text := "".join(shown[name] for name in names))
    }


# -- captures of a few packets ----------------------------------------------------------------------

Said = tuple[int, bool | None, bytes]  # ms, sent, bytes


def capture_of(path: Path, name: str, *said: Said, settings: Any = None) -> Path:
    """A capture in which this passes on one line, at these times."""
    protocol = PROTOCOLS[name]
    writer = CaptureWriter.create(path)
    line = writer.add_line(protocol, settings or protocol.line, "/dev/test")
    for at, sent, raw in said:
        writer.add(line, raw, START_NS + at * 10**6, sent=sent)
    writer.close()
    return path


def pairs(path: Path, name: str, home: Path) -> list[str]:
    """Of each packet: `>N` answered in N, `<N` answers N, `=N` an echo of N, `?` answers nothing, `-`."""
    links = {">": "response_in", "<": "request_in", "=": "echo_of"}
    asked = [f"{name}.{field}" for field in (*links.values(), "expert.no_request")]
    found = []
    for row in dissected(path, asked, home=home):
        marks = [sign + row[f"{name}.{field}"] for sign, field in links.items()]
        text = "".join(mark for mark in marks if len(mark) > 1)
        found.append(text or ("?" if row[f"{name}.expert.no_request"] else "-"))
    return found


READ = slink3.Frame(2, 4, 0, 0x26, bytes.fromhex("03 2C 20"))
ANSWER = slink3.Frame(2, 4, 1, 0, bytes.fromhex("03 2C 20 07 00"))


def test_slink3_questions_and_answers_find_each_other(tmp_path: Path) -> None:
    path = capture_of(
        tmp_path / "a.pcapng",
        "slink3",
        (0, None, READ.encode()),
        (30, None, ANSWER.encode()),
        (100, None, READ.numbered(2).encode()),  # asked again with the next number
        (1700, None, READ.numbered(3).encode()),
        (1750, None, ANSWER.numbered(3).encode()),
        (1760, None, ANSWER.numbered(2).encode()),  # too late for 1.5 s
        (2000, None, READ.encode()),
        (2020, None, slink3.Frame(2, 4, 1, 0, bytes.fromhex("03 2D 20 07 00")).encode()),
        (2050, None, slink3.Frame(2, 4, 1, 1).encode()),
        (2100, None, slink3.Frame(255, 0, 0, 0x20).encode()),
        (2200, None, slink3.Frame(2, 8, 0, 0x26, bytes.fromhex("83 2C 20 01")).encode()),
        (2220, None, slink3.Frame(2, 8, 1, 0, bytes.fromhex("83 2C 20 02 07 00")).encode()),
        (2250, None, slink3.Frame(2, 8, 1, 0, bytes.fromhex("83 2C 20 01 07 00")).encode()),
    )
    expected = [">2", "<1", "-", ">5", "<4", "?", ">9", "?", "<7", "-", ">13", "?", "<11"]
    assert pairs(path, "slink3", tmp_path) == expected


def test_lines_of_one_protocol_are_told_apart(tmp_path: Path) -> None:
    protocol, path = PROTOCOLS["slink3"], tmp_path / "two.pcapng"
    writer = CaptureWriter.create(path)
    lines = [writer.add_line(protocol, protocol.line, name) for name in ("/dev/a", "/dev/b")]
    frames = [READ, READ, ANSWER, ANSWER]
    for at, (line, frame) in enumerate(zip(lines * 2, frames, strict=True)):
        writer.add(line, frame.encode(), START_NS + at * 10**7)
    writer.close()
    assert pairs(path, "slink3", tmp_path) == [">3", ">4", "<1", "<2"]


def test_an_answer_has_its_time(tmp_path: Path) -> None:
    path = capture_of(
        tmp_path / "a.pcapng", "slink3", (0, None, READ.encode()), (33, None, ANSWER.encode())
    )
    rows = dissected(path, ["slink3.response_time"], home=tmp_path)
    assert [float(row["slink3.response_time"] or "nan") for row in rows][1] == pytest.approx(0.033)


def test_an_echo_is_no_question_and_no_answer(tmp_path: Path) -> None:
    action = ultra3000.Frame(0, 0x71, 1).encode()
    read = ultra3000.Frame(0, 0x00, 0).encode()
    path = capture_of(
        tmp_path / "a.pcapng",
        "ultra3000",
        (0, True, action),
        (20, False, action),
        (100, True, action),
        (101, False, action),  # before ten characters could have passed again
        (120, False, action),
        (200, True, read),
        (210, False, read),  # no answer looks like this
        (220, False, ultra3000.Frame(0, 0x00, 0, "01").encode()),
        (300, True, action),
        (310, False, action),  # by now the line is known to hear itself
        (330, False, action),
    )
    expected = [">2", "<1", ">5", "=3", "<3", ">8", "=6", "<6", ">11", "=9", "<9"]
    assert pairs(path, "ultra3000", tmp_path) == expected


def test_an_echo_that_is_only_overheard_overlaps_its_question(tmp_path: Path) -> None:
    said = [(0, READ), (1, READ), (40, ANSWER), (100, READ), (150, READ), (190, ANSWER)]
    path = capture_of(
        tmp_path / "a.pcapng", "slink3", *((at, None, frame.encode()) for at, frame in said)
    )
    assert pairs(path, "slink3", tmp_path) == [">3", "=1", "<1", "-", ">6", "<5"]


def test_an_action_that_is_only_overheard_finds_its_answer(tmp_path: Path) -> None:
    action = ultra3000.Frame(0, 0x71, 1).encode()
    refusal = ultra3000.Frame(0, 0x871, 1, "06").encode()
    path = capture_of(
        tmp_path / "a.pcapng",
        "ultra3000",
        (0, None, action),
        (20, None, action),
        (100, None, action),
        (120, None, refusal),
        (5000, None, action),
    )
    assert pairs(path, "ultra3000", tmp_path) == [">2", "<1", ">4", "<3", "?"]


def test_a_change_of_datalink_shows_echo_and_acknowledge(tmp_path: Path) -> None:
    change = datalink.Frame(datalink.Command.CHANGE, 3, 0x600, 2, b"\x7e\x01")
    echo = change._replace(command=datalink.Command.RESPONSE)
    acknowledge = datalink.Frame(datalink.Command.ACKNOWLEDGE, 3)
    path = capture_of(
        tmp_path / "a.pcapng",
        "datalink",
        (0, True, change.encode()),
        (20, False, echo.encode()),
        (60, True, acknowledge.encode()),
        (100, True, change.encode()),
        (120, False, echo._replace(data=b"\x7e\x02").encode()),
        (240, True, acknowledge.encode()),
        (300, True, acknowledge.encode()),
    )
    asked = ["acknowledged_in", "acknowledges", "acknowledge_time"]
    asked += ["expert.echo_differs", "expert.late_acknowledge"]
    rows = dissected(path, [f"datalink.{field}" for field in asked], home=tmp_path)
    shown = [[field for field in asked if row[f"datalink.{field}"]] for row in rows]
    assert pairs(path, "datalink", tmp_path)[:2] == [">2", "<1"]
    assert shown == [
        ["acknowledged_in"],
        [],
        ["acknowledges", "acknowledge_time"],
        ["acknowledged_in"],
        ["expert.echo_differs"],
        ["acknowledges", "acknowledge_time", "expert.late_acknowledge"],
        [],
    ]
    assert float(rows[2]["datalink.acknowledge_time"]) == pytest.approx(0.040)


def test_data_mean_what_the_question_says(tmp_path: Path) -> None:
    status, word = slink3.Frame(2, 8, 0, 0x23), slink3.Frame(2, 8, 1, 0, b"\x40\x02")
    code, malfunction = slink3.Frame(2, 12, 0, 0x2F), slink3.Frame(2, 12, 1, 0, b"\x10\x23")
    standard = slink3.Frame(2, 16, 0, 0x24, b"\x41\x60\x00")
    answer = slink3.Frame(2, 16, 1, 0, b"\x41\x60\x00\x40\x02")
    frames = [status, word, code, malfunction, standard, answer]
    said: list[Said] = [(30 * at, None, frame.encode()) for at, frame in enumerate(frames)]
    path = capture_of(tmp_path / "a.pcapng", "slink3", *said)
    asked = ["status_word", "malfunction_code", "index", "value"]
    rows = dissected(path, [f"slink3.{field}" for field in asked], home=tmp_path)
    assert rows[1]["slink3.status_word"] == "0x0240"
    assert rows[3]["slink3.malfunction_code"] == "0x2310"
    assert (rows[5]["slink3.index"], rows[5]["slink3.value"]) == ("24641", "40 02")


# -- damage that no capture has marked ----------------------------------------------------------------

BROKEN = {
    "slink3": [
        READ.encode()[:-1] + b"\x00",
        READ.encode()[:-2],
        b"\x01\x02",
        b"\x01\x02\x04\x07\x00\x00",
        b"\xff\x00",
    ],
    "datalink": [
        bytes.fromhex("7E E3 09 00 06 00"),
        bytes.fromhex("7E E3 09 00"),
        bytes.fromhex("7E E3 09 7E E3 09"),
        bytes.fromhex("7E 43 09 00 06 52"),
        bytes.fromhex("7E A3 21 00 06"),
        b"\x7e",
        b"\x00\x7e",
    ],
    "ultra3000": [
        b":0006110178\r",
        b":00061101",
        b":0006d10177\r",
        b":000611\r",
        b":" + b"0" * 300,
        b"\n",
        b"x",
    ],
}


@pytest.mark.parametrize("name", list(BROKEN))
def test_of_unmarked_damage_the_reason_is_multidrop_s_own(name: str, tmp_path: Path) -> None:
    module: Any = {"slink3": slink3, "datalink": datalink, "ultra3000": ultra3000}[name]
    reasons = []
    for raw in BROKEN[name]:
        with pytest.raises(UsageError) as caught:
            module.Frame.decode(raw)
        reasons.append(str(caught.value).partition(": ")[2].rpartition(" (")[0])
    said: list[Said] = [(9 * at, None, raw) for at, raw in enumerate(BROKEN[name])]
    path = capture_of(tmp_path / "a.pcapng", name, *said)
    rows = dissected(path, [f"{name}.damage", f"{name}.checksum.status", INFO], home=tmp_path)
    assert [row[f"{name}.damage"] for row in rows] == reasons
    assert [row[f"{name}.checksum.status"] for row in rows] == ["0", *[""] * (len(reasons) - 1)]


def test_frames_and_damage_that_another_program_put_into_one_packet(tmp_path: Path) -> None:
    raw = b"\xff\xff" + READ.encode() + ANSWER.encode() + b"\x01\x02"
    path = capture_of(tmp_path / "a.pcapng", "slink3", (0, None, raw))
    (row,) = dissected(path, [INFO], home=tmp_path)
    assert row[INFO] == (
        "! no START; 2 #1 read typed parameter 8236:int16; 2 #1 OK 8236:int16 = 7; ! cut short"
    )


def test_bytes_of_no_known_protocol(tmp_path: Path) -> None:
    path = tmp_path / "raw.pcapng"
    writer = CaptureWriter.create(path)
    writer.add(writer.add_line(None, PROTOCOLS["slink3"].line), b"AT\r\xff", START_NS)
    writer.close()
    asked = ["multidrop.data", "multidrop.text", INFO]
    (row,) = dissected(path, asked, home=tmp_path)
    assert octets(row["multidrop.data"]) == b"AT\r\xff"
    assert row["multidrop.text"] == r"'AT\r\xff'"
    assert row[INFO] == "41 54 0D FF"


# -- the page ------------------------------------------------------------------------------------------

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "wireshark.md"


def fields_of_the_page() -> set[str]:
    """`a.b`, `.c` of a row are a.b and a.c; PROTOCOL stands for all three."""
    found = set()
    for row in re.findall(r"^\| (`[\w.]+`(?:, `[\w.]+`)*) \|", PAGE.read_text("utf-8"), re.M):
        first, *others = re.findall(r"`([\w.]+)`", row)
        above = first.rpartition(".")[0]
        for name in (first, *(f"{above}{other}" if other[0] == "." else other for other in others)):
            found |= {name.replace("PROTOCOL", protocol) for protocol in FIELDS}
    return found


def test_the_page_names_every_field_and_no_other(tmp_path: Path) -> None:
    out = tshark("-G", "fields", "-X", f"lua_script:{LUA}", home=tmp_path)
    names = {line.split("\t")[2] for line in out.splitlines() if line.startswith("F\t")}
    registered = {name for name in names if name.partition(".")[0] in FIELDS}
    assert fields_of_the_page() == registered
