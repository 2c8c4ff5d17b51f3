"""Captures: what is written comes back, whatever the file went through."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from multidrop.errors import UsageError
from multidrop.io import pcapng
from multidrop.io.capture import RAW, CaptureReader, CaptureTap, CaptureWriter, Known, Packet
from multidrop.protocols import PROTOCOLS, slink3

SLINK3 = PROTOCOLS["slink3"]
QUESTION = slink3.Frame(2, 4, 0, 0x26, bytes.fromhex("00 03 F1")).encode()
ANSWER = slink3.Frame(2, 4, 1, 0, bytes.fromhex("03 F1 03 7D 00")).encode()
CHARACTER = slink3.LINE.character
WALL = 1_700_000_000_000_000_000


def wall(now: float) -> int:
    return WALL + round(now * 1e9)


def read(path: Path) -> tuple[list[Packet], CaptureReader]:
    reader = CaptureReader(path)
    return list(reader.packets()), reader


def written(path: Path, packets: int = 3) -> list[int]:
    """A small capture; returns how long the file was after each block."""
    writer = CaptureWriter.create(path)
    sizes = [path.stat().st_size]
    line = writer.add_line(SLINK3, slink3.LINE, "/dev/ttyUSB0", [Known(2, "ax-v", "winder one")])
    sizes.append(path.stat().st_size)
    for number in range(packets):
        writer.add(line, QUESTION[: 7 + number], WALL + number, sent=None)
        sizes.append(path.stat().st_size)
    writer.close()
    return sizes


def test_everything_written_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    writer = CaptureWriter.create(path)
    line = writer.add_line(SLINK3, slink3.LINE, "/dev/ttyUSB0", [Known(2, "ax-v", "winder one")])
    other = writer.add_line(None, slink3.LINE, "COM3")
    writer.add(line, QUESTION, WALL, sent=True)
    writer.add(line, ANSWER, WALL + 1, sent=False)
    writer.add(line, b"\x01\xff", WALL + 2, sent=False, damage="cut short")
    writer.add(other, b"abc", WALL + 3, damage="parity or framing error", marked=True)
    writer.close()
    packets, reader = read(path)
    first, second = reader.interfaces
    assert (first.link_type, first.name, first.description, first.baud) == (
        147,
        "/dev/ttyUSB0",
        "slink3 9600 8E1",
        9600,
    )
    assert first.protocol is not None
    assert first.protocol.name == "slink3"
    assert first.devices == {2: Known(2, "ax-v", "winder one")}
    assert (second.link_type, second.description, second.protocol) == (RAW, "raw 9600 8E1", None)
    assert [(item.data, item.time_ns - WALL, item.interface) for item in packets] == [
        (QUESTION, 0, 0),
        (ANSWER, 1, 0),
        (b"\x01\xff", 2, 0),
        (b"abc", 3, 1),
    ]
    assert [item.sent for item in packets] == [True, False, False, None]
    assert [item.damaged for item in packets] == [False, False, True, True]
    assert [item.comment for item in packets[2:]] == ["cut short", "parity or framing error"]
    assert reader.ending == ""
    assert reader.at == path.stat().st_size


def test_every_block_is_in_the_file_as_soon_as_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    sizes = written(path)
    assert sizes == sorted(set(sizes))
    whole = path.read_bytes()
    for count, size in enumerate(sizes[1:]):
        path.write_bytes(whole[:size])
        packets, reader = read(path)
        assert (len(packets), reader.ending) == (count, "")


def test_a_file_that_is_cut_anywhere_gives_what_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    sizes = written(path)
    whole = path.read_bytes()
    for size in range(12, len(whole)):
        path.write_bytes(whole[:size])
        packets, reader = read(path)
        assert len(packets) == max(sum(size >= at for at in sizes) - 2, 0)
        assert ("cut short" in reader.ending) == (size not in sizes)


def test_a_file_that_is_broken_gives_what_is_before(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    sizes = written(path)
    whole = bytearray(path.read_bytes())
    for at, value, why in (
        (4, 13, "a block of 13 bytes"),
        (4, 1 << 25, "a block of 33554432 bytes"),
        (4, 48, "the two lengths of a block differ"),
        (8, 9, "a packet that cannot be"),  # its interface
        (20, 4000, "a packet that cannot be"),  # its size
    ):
        broken = bytearray(whole)
        struct.pack_into("<I", broken, sizes[2] + at, value)
        path.write_bytes(broken)
        packets, reader = read(path)
        assert len(packets) == 1
        assert reader.ending == f"the file is broken from byte {sizes[2]} on: {why}"


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "is empty"),
        (b"\x0a\x0d\x0d\x0a\x50\x00", "the beginning of a pcapng file, and no more"),
        (bytes.fromhex("d4c3b2a1 0200 0400 00000000"), "older pcap format; editcap -F pcapng"),
        (b"\x1f\x8b\x08\x00\x00\x00", "is compressed"),
        (b"01 02 03 04 05 06 07", "is no capture"),
    ],
)
def test_what_is_no_capture_is_refused(tmp_path: Path, content: bytes, why: str) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=why):
        CaptureReader(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="No such file"):
        CaptureReader(tmp_path / "a")
    with pytest.raises(UsageError, match=r"cannot write .*: Is a directory"):
        CaptureWriter.create(tmp_path)


def test_a_foreign_interface_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    path.write_bytes(
        pcapng.section("x", "y") + pcapng.interface(1, [(pcapng.INTERFACE_NAME, b"eth0")])
    )
    with pytest.raises(UsageError, match="eth0 has link type 1, which is no line of multidrop"):
        read(path)


def big_endian(kind: int, body: bytes) -> bytes:
    length = struct.pack(">I", len(body) + 12)
    return struct.pack(">I", kind) + length + body + length


def test_other_writers(tmp_path: Path) -> None:
    """Two sections, the second big-endian with microseconds, an offset and a block in between."""
    path = tmp_path / "a.pcapng"
    written(path)
    offset = struct.pack(">HHqI", pcapng.INTERFACE_OFFSET, 8, 3600, 0)
    flags = struct.pack(">HHII", pcapng.PACKET_FLAGS, 4, pcapng.OUTBOUND, 0)
    path.write_bytes(
        path.read_bytes()
        + big_endian(pcapng.SECTION, struct.pack(">IHHq", pcapng.BYTE_ORDER, 1, 0, -1))
        + big_endian(pcapng.INTERFACE, struct.pack(">HHI", 148, 0, 0) + offset)
        + big_endian(4, bytes(8))
        + big_endian(
            pcapng.PACKET, struct.pack(">IIIII", 0, 0, 5_000_000, 2, 2) + b"~\x80\0\0" + flags
        )
    )
    packets, reader = read(path)
    assert reader.ending == ""
    assert packets[3] == Packet(b"~\x80", 3605 * 10**9, pcapng.OUTBOUND, "", 1)
    assert reader.interfaces[1].protocol is not None
    assert reader.interfaces[1].protocol.name == "datalink"


def test_reading_goes_on_from_any_packet(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    sizes = written(path)
    packets, reader = read(path)
    assert list(reader.packets(sizes[2], sizes[3])) == packets[1:2]
    assert list(reader.packets(sizes[3])) == packets[2:]


class Full(io.BytesIO):
    """A disk with room for so many bytes."""

    room = 300

    def write(self, data: bytes) -> int:  # type: ignore[override]
        return super().write(data[: max(self.room - self.tell(), 0)])


def test_a_disk_that_fills_up_leaves_a_whole_file(tmp_path: Path) -> None:
    disk = Full()
    writer = CaptureWriter(disk)
    line = writer.add_line(SLINK3, slink3.LINE)
    for number in range(9):
        writer.add(line, QUESTION, WALL + number)
    assert writer.failed is not None
    assert 0 < writer.packets < 9
    path = tmp_path / "a.pcapng"
    path.write_bytes(disk.getvalue())
    packets, reader = read(path)
    assert (len(packets), reader.ending) == (writer.packets, "")


@contextlib.contextmanager
def tapped(path: Path) -> Iterator[CaptureTap]:
    writer = CaptureWriter.create(path)
    tap = CaptureTap(writer, SLINK3, slink3.LINE, "p", wall=wall)
    yield tap
    tap.finish()
    writer.close()


def seconds(packets: list[Packet]) -> list[float]:
    return [(item.time_ns - WALL) / 1e9 for item in packets]


def test_a_tap_gives_each_frame_the_time_of_its_last_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    with tapped(path) as tap:
        tap(QUESTION, True, 1.0, False)
        for number, byte in enumerate(ANSWER):
            tap(bytes([byte]), False, 1.02 + number * CHARACTER, False)
        tap(QUESTION, True, 2.0, False)
        tap(b"\x01\x02" + ANSWER + ANSWER, False, 2.1, False)  # a burst
        tap(ANSWER[:5], False, 2.11, False)
        tap(ANSWER, False, 3.0, False)  # what was before it fell silent
    packets, _ = read(path)
    assert [item.data for item in packets] == [
        *(QUESTION, ANSWER, QUESTION, b"\x01\x02", ANSWER, ANSWER, ANSWER[:5], ANSWER)
    ]
    assert [item.sent for item in packets] == [True, False, True, *[False] * 5]
    size = len(ANSWER) * CHARACTER
    assert seconds(packets) == pytest.approx(
        [
            1.0 + len(QUESTION) * CHARACTER,
            1.02 + (len(ANSWER) - 1) * CHARACTER,
            2.0 + len(QUESTION) * CHARACTER,
            2.1 - 2 * size,
            2.1 - size,
            2.1,
            2.11,
            3.0,
        ],
        abs=1e-8,
    )


def test_on_a_line_without_time_a_request_ends_when_it_was_sent(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    with tapped(path) as tap:
        tap(QUESTION, True, 1.0, False)
        tap(ANSWER, False, 1.0005, False)
    assert seconds(read(path)[0]) == pytest.approx([1.0, 1.0005], abs=1e-8)


def test_an_echo_says_when_the_request_ended(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    with tapped(path) as tap:
        tap(QUESTION, True, 1.0, False)
        for number, byte in enumerate(QUESTION):
            tap(bytes([byte]), False, 1.0 + (number + 1) * CHARACTER * 0.99, False)
    end = 1.0 + len(QUESTION) * CHARACTER * 0.99
    assert seconds(read(path)[0]) == pytest.approx([end, end], abs=1e-8)


def test_bytes_that_the_port_marked_are_damage_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    with tapped(path) as tap:
        tap(ANSWER[:4], False, 1.0, False)
        tap(b"\x55", False, 1.001, True)
        tap(ANSWER, False, 1.02, False)
    packets, _ = read(path)
    assert [(item.data, item.comment) for item in packets] == [
        (ANSWER[:4], "cut short"),
        (b"\x55", "parity or framing error"),
        (ANSWER, ""),
    ]
    errors = [item.flags & pcapng.ERRORS for item in packets]
    assert errors == [pcapng.UNALIGNED_ERROR, pcapng.SYMBOL_ERROR, 0]
