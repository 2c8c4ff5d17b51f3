"""Raw TCP lines, and everything that the other side of one can do wrong."""

from __future__ import annotations

import itertools
import socket
import struct
from collections.abc import Callable

import pytest

from integration.processes import multidrop as command
from integration.servers import Connected, answering, reply_to, serving
from integration.ways import Way
from multidrop import DeviceError, NoReply, OutcomeUnknown, PortError, ProtocolError, UsageError
from multidrop.protocols.slink3 import Frame

FAST = "timeout=0.15,silence=0.05,attempts=2"
READ = ("read", "1009:int16")


def ipa_1009(request: Frame, value: int = 125) -> Frame:
    """The AX-V's answer to a read of IPA 1009."""
    return reply_to(request, 0, b"\x03\xf1\x03" + struct.pack("<h", value))


def first_request(then: Callable[[Connected, bytes], None]) -> Callable[[Connected], None]:
    """A behaviour: `then(line, answer)` once the first request is there."""

    def behave(line: Connected) -> None:
        request = next(line.requests(), None)
        if request is not None:
            then(line, ipa_1009(request).encode())

    return behave


def half_and_gone(line: Connected, answer: bytes) -> None:
    line.send(answer[:6])


def gone(line: Connected, answer: bytes) -> None:
    pass


@pytest.mark.parametrize("then", [gone, half_and_gone])
def test_the_server_closes_in_the_middle(
    way: Way, then: Callable[[Connected, bytes], None]
) -> None:
    with (
        serving(first_request(then)) as server,
        pytest.raises(PortError, match="was lost: the other side closed the connection"),
    ):
        way(f"ax-v:2@{server.port}", READ)


def test_the_server_closes_between_two_requests(way: Way) -> None:
    with (
        serving(first_request(lambda line, answer: line.send(answer))) as server,
        pytest.raises(PortError, match="was lost"),
    ):
        way(f"ax-v:2@{server.port}", READ, READ)


def test_the_server_resets_the_connection(way: Way) -> None:
    def reset(line: Connected, answer: bytes) -> None:
        off = struct.pack("ii", 1, 0)  # linger for 0 s: the end comes as a reset
        line.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, off)

    with serving(first_request(reset)) as server, pytest.raises(PortError, match="was lost"):
        way(f"ax-v:2@{server.port}", READ)


def test_nobody_listens(way: Way) -> None:
    with socket.socket() as bound:  # bound, not listening: nobody else gets the number
        bound.bind(("127.0.0.1", 0))
        port = f"tcp://127.0.0.1:{bound.getsockname()[1]}"
        with pytest.raises(
            PortError, match=f"cannot open {port}: connection refused: nothing listens"
        ):
            way(f"ax-v:2@{port}", READ)
        ran = command("read", f"ax-v:2@{port}", "1009", "1111", "--json")
    assert ran.status == 5
    assert [line["error"]["kind"] for line in ran.objects] == ["port", "port"]
    assert [line["point"] for line in ran.objects] == ["1009", "1111"]


def test_no_such_host(way: Way) -> None:
    with pytest.raises(PortError, match=r"nowhere\.invalid:4001: no such host"):
        way("ax-v:2@tcp://nowhere.invalid:4001", READ)


@pytest.mark.parametrize(
    "port", ["tcp://", "tcp://host", "tcp://host:0x10", "tcp://host:70000", "tcp://h:1/x"]
)
def test_an_address_that_is_none(port: str, way: Way) -> None:
    with pytest.raises(UsageError):
        way(f"ax-v:2@{port}", READ)


def test_direction_kernel_on_a_socket(way: Way) -> None:
    with (
        answering(ipa_1009) as server,
        pytest.raises(PortError, match="direction=kernel needs a serial port of this machine"),
    ):
        way(f"ax-v:2@{server.port},direction=kernel", READ)


def test_half_a_frame_and_silence(way: Way) -> None:
    def half(line: Connected) -> None:
        for request in line.requests():
            line.send(ipa_1009(request).encode()[:6])

    with serving(half) as server:
        with pytest.raises(NoReply) as caught:
            way(f"ax-v:2@{server.port},{FAST}", READ)
        assert len(server.frames()) == 2
    assert caught.value.attempts == 2
    assert [len(piece) for piece in caught.value.damaged] == [6, 6]


def test_half_a_frame_then_the_whole_one(way: Way) -> None:
    """The first attempt's answer is cut short; the second's is believed."""
    halves = iter([6])

    def half_once(line: Connected) -> None:
        for request in line.requests():
            line.send(ipa_1009(request).encode()[: next(halves, None)])

    with serving(half_once) as server:
        assert way(f"ax-v:2@{server.port},{FAST}", READ)[0].value == 125


def test_an_answer_byte_by_byte(way: Way) -> None:
    def bytewise(line: Connected) -> None:
        for request in line.requests():
            for byte in ipa_1009(request).encode():
                line.send(bytes([byte]))

    with serving(bytewise) as server:
        assert [found.value for found in way(f"ax-v:2@{server.port}", *[READ] * 20)] == [125] * 20


@pytest.mark.parametrize("cut", range(1, 13))
def test_an_answer_in_two_bursts(way: Way, cut: int) -> None:
    def burst(line: Connected) -> None:
        for request in line.requests():
            answer = ipa_1009(request).encode()
            line.send(answer[:cut])
            line.pause(0.02)
            line.send(answer[cut:])

    with serving(burst) as server:
        assert way(f"ax-v:2@{server.port},silence=1", READ)[0].value == 125
        assert len(server.frames()) == 1


def test_much_before_the_answer(way: Way) -> None:
    """Noise, another slave's answer, a late answer, an echo: the right one is found behind them."""

    def crowded(line: Connected) -> None:
        for request in line.requests():
            answer = ipa_1009(request)
            other = ipa_1009(request._replace(address=3), 999)
            late = ipa_1009(request.numbered((request.control >> 2) - 1 & 15), 998)
            line.send(b"\x01\x7f" + other.encode() + request.encode() + late.encode())
            line.send(answer.encode())

    with serving(crowded) as server:
        assert [found.value for found in way(f"ax-v:2@{server.port}", *[READ] * 5)] == [125] * 5


def test_a_babbling_line(way: Way) -> None:
    """It never falls silent and says nothing: the read ends all the same, and soon."""

    def babble(line: Connected) -> None:
        for number in itertools.count():
            line.send(bytes([0xA0 | number & 0x0F]) * 100)
            line.pause(0.005)

    with serving(babble) as server, pytest.raises(NoReply) as caught:
        way(f"ax-v:2@{server.port},{FAST}", READ)
    assert caught.value.attempts <= 2


def test_a_line_that_babbles_starts_of_frames(way: Way) -> None:
    def babble(line: Connected) -> None:
        while True:
            line.send(b"\x01\x02\x00\xff" * 10)
            line.pause(0.005)

    with serving(babble) as server, pytest.raises(NoReply):
        way(f"ax-v:2@{server.port},{FAST}", READ)


def test_an_answer_that_comes_before_its_question(way: Way) -> None:
    """Behind each answer comes one that would fit the next request: it is not believed."""

    def hasty(line: Connected) -> None:
        for request in line.requests():
            following = request.numbered((request.control >> 2) + 1)
            line.send(ipa_1009(request).encode() + ipa_1009(following, 999).encode())

    with serving(hasty) as server:
        assert [found.value for found in way(f"ax-v:2@{server.port}", *[READ] * 5)] == [125] * 5


def test_an_answer_of_another_type_breaks_the_protocol(way: Way) -> None:
    def other_type(request: Frame) -> Frame:
        return reply_to(request, 0, b"\x04\xf1\x03" + bytes(4))

    with (
        answering(other_type) as server,
        pytest.raises(ProtocolError, match="type int32 came, int16 was asked for"),
    ):
        way(f"ax-v:2@{server.port}", READ)


def test_a_refusal(way: Way) -> None:
    with (
        answering(lambda request: reply_to(request, 0x0001)) as server,
        pytest.raises(DeviceError, match="0001h: parameter does not exist"),
    ):
        way(f"ax-v:2@{server.port}", READ)


def test_a_write_that_is_cut_off_is_not_done(way: Way) -> None:
    """The old value was read, the write went out, and the server is gone: nobody knows."""

    def reads_only(line: Connected) -> None:
        for request in line.requests():
            if request.code == 0x27:
                return
            line.send(ipa_1009(request).encode())

    with serving(reads_only) as server, pytest.raises(OutcomeUnknown, match="went out, then"):
        way(f"ax-v:2@{server.port}", ("write", "1009:int16", 5))


def test_a_write_before_which_the_line_is_cut_off(way: Way) -> None:
    with (
        serving(first_request(gone)) as server,
        pytest.raises(PortError),
    ):
        way(f"ax-v:2@{server.port}", ("write", "1009:int16", 5))


def test_a_server_that_takes_one_client_at_a_time(way: Way) -> None:
    """It accepts the second one and is busy with the first: no answer, no hang."""
    with (
        answering(ipa_1009) as server,
        socket.create_connection(("127.0.0.1", int(server.port.rpartition(":")[2]))),
    ):
        server.await_connections(1)
        with pytest.raises(NoReply):
            way(f"ax-v:2@{server.port},{FAST}", READ)
