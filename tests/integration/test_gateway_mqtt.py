"""The MQTT side of the gateway: with a real Mosquitto, and its own clients."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import re
import subprocess
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from integration.mosquitto import Broker, broker, found
from integration.processes import COMMAND, PATIENCE, Running
from integration.published import DEVICES, Published, published, ran
from integration.threads import simulated
from integration.writes import logged
from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.gateway.mqtt import broker as mqtt_broker
from multidrop.gateway.mqtt import carrying_out
from multidrop.gateway.mqtt import part as mqtt
from multidrop.gateway.mqtt.part import Mqtt
from multidrop.plantfile import parse_plant

TORQUE = "multidrop/infeed/torque"
SET = f"{TORQUE}/set"
SLOW = DEVICES.replace('8511:uint16", every = 0.2', '8511:uint16", every = 9000')
"""With a point that is not read for hours."""


def tables(port: int, *more: str) -> str:
    return "\n".join(["[mqtt]", 'host = "127.0.0.1"', f"port = {port}", *more, ""])


@contextlib.asynccontextmanager
async def connected(
    folder: Path, mosquitto: Broker, *more: str, devices: str = DEVICES
) -> AsyncIterator[Published]:
    """A gateway that is connected, and whose points have been read once."""
    async with published(folder, tables(mosquitto.port, *more), devices) as site:
        part = site.gateway.parts["mqtt"]
        assert isinstance(part, Mqtt)
        await site.until(lambda: part.connected_at is not None)
        await site.until_value("infeed", "torque", 0)
        yield site


def _is_known(payload: Any) -> bool:
    return not isinstance(payload, dict) or payload.get("quality") != "not read yet"


class Watcher:
    """Somebody who subscribes: what came last on each topic."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self.client = client
        self.seen: dict[str, bytes] = {}
        self.messages: list[aiomqtt.Message] = []

    async def until(self, topic: str, right: Callable[[Any], bool] = _is_known) -> Any:
        """The first payload of a topic that is right; JSON where it is."""
        async with asyncio.timeout(PATIENCE):
            while True:
                if topic in self.seen and right(payload := _plain(self.seen[topic])):
                    return payload
                message = await anext(aiter(self.client.messages))
                self.seen[str(message.topic)] = bytes(message.payload)
                self.messages.append(message)

    async def command(
        self,
        payload: str,
        topic: str = SET,
        *,
        expiry: int | None = 5,
        response: str | None = "answers/test",
        retain: bool = False,
    ) -> None:
        facts = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        if expiry is not None:
            facts.MessageExpiryInterval = expiry
        if response is not None:
            facts.ResponseTopic = response
            facts.CorrelationData = b"\x00\xffthis one"
        await self.client.publish(topic, payload, qos=2, retain=retain, properties=facts)

    async def answer(self) -> dict[str, Any]:
        """What came of a command; its correlation data were right."""
        self.seen.pop("answers/test", None)
        found: dict[str, Any] = await self.until("answers/test")
        facts = self.messages[-1].properties
        assert facts is not None
        assert vars(facts)["CorrelationData"] == b"\x00\xffthis one"
        return found


def _plain(payload: bytes) -> Any:
    try:
        return json.loads(payload)
    except ValueError:
        return payload.decode()


@contextlib.asynccontextmanager
async def watcher(mosquitto: Broker, *topics: str) -> AsyncIterator[Watcher]:
    protocol = aiomqtt.ProtocolVersion.V5
    async with aiomqtt.Client("127.0.0.1", mosquitto.port, protocol=protocol) as client:
        for topic in topics or ("multidrop/#", "answers/#"):
            await client.subscribe(topic, qos=2)
        yield Watcher(client)


def run(
    folder: Path,
    test: Callable[[Published, Broker, Watcher], Awaitable[None]],
    *more: str,
    devices: str = DEVICES,
) -> None:
    async def main(mosquitto: Broker) -> None:
        async with (
            connected(folder, mosquitto, *more, devices=devices) as site,
            watcher(mosquitto) as watching,
        ):
            await test(site, mosquitto, watching)

    with broker(folder) as mosquitto:
        asyncio.run(main(mosquitto))


async def subscribed(mosquitto: Broker, *arguments: str) -> list[str]:
    """What mosquitto_sub prints."""
    program = found("mosquitto_sub")
    port = str(mosquitto.port)
    status, out = await ran(program, "-V", "5", "-p", port, "-W", "10", *arguments)
    assert status in (0, 27), out
    return out.splitlines()


def test_states_are_retained_for_whoever_comes_later(tmp_path: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        await watching.until("multidrop/unwinder/missing")
        await watching.until("multidrop/unwinder/tension")
        await watching.until("multidrop/infeed/speed")
        await watching.until("multidrop/infeed/bus_address")
        lines = await subscribed(mosquitto, "-t", "multidrop/#", "-C", "6", "-F", "%r %t %p")
        kept = {line.split(" ", 2)[1]: line.split(" ", 2)[2] for line in lines}
        assert all(line.startswith("1 ") for line in lines)
        assert set(kept) == {
            "multidrop/status",
            "multidrop/infeed/torque",
            "multidrop/infeed/speed",
            "multidrop/infeed/bus_address",
            "multidrop/unwinder/tension",
            "multidrop/unwinder/missing",
        }
        assert kept["multidrop/status"] == "online"
        state = json.loads(kept["multidrop/unwinder/tension"])
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", state.pop("time"))
        assert state == {"value": 12.5, "unit": "N", "quality": "good"}
        missing = json.loads(kept["multidrop/unwinder/missing"])
        assert (missing["value"], missing["quality"]) == (None, "refused")
        assert missing["error"].startswith("refused with code")
        assert "last" not in missing

    run(tmp_path, check)


def test_a_change_comes_at_once_and_what_is_old_is_no_value(tmp_path: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        drive = site.line.devices[0]
        await site.gateway.write("infeed", "torque", 7, who="test", origin="test")
        await watching.until(TORQUE, lambda state: state["value"] == 7)
        site.line.devices.remove(drive)
        state = await watching.until(TORQUE, lambda state: state["quality"] == "no reply")
        assert (state["value"], state["last"]) == (None, 7)
        assert state["last_time"] < state["time"]
        site.line.devices.append(drive)
        await site.gateway.line_of("infeed").service.try_now("infeed")
        await watching.until(TORQUE, lambda state: state["value"] == 7)

    run(tmp_path, check)


def test_what_does_not_change_is_not_sent_again_until_it_is_old(tmp_path: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        await watching.until("multidrop/unwinder/tension")
        for value in (1, 2, 3):  # the dead band is 2
            await site.gateway.write("infeed", "torque", value, who="test", origin="test")
            await site.until_value("infeed", "torque", value)
        await watching.until(TORQUE, lambda state: state["value"] == 2)
        await site.gateway.write("infeed", "torque", 9, who="test", origin="test")
        await watching.until(TORQUE, lambda state: state["value"] == 9)
        payloads = [json.loads(m.payload) for m in watching.messages if str(m.topic) == TORQUE]
        values = [state["value"] for state in payloads if _is_known(state)]
        assert values == [0, 2, 9]
        before = len(watching.messages)
        part = site.gateway.parts["mqtt"]
        assert isinstance(part, Mqtt)
        object.__setattr__(part.settings, "longest", 0.2)
        old = watching.seen.pop(TORQUE)
        state = await watching.until(TORQUE)
        assert state["time"] > json.loads(old)["time"]
        assert len(watching.messages) > before

    dead = DEVICES.replace('unit = "Nm",', 'unit = "Nm", deadband = 2,')
    run(tmp_path, check, devices=dead)


def test_a_point_that_is_another_after_a_reload_is_sent_again(tmp_path: Path) -> None:
    """Though it has the same number: that means something else now."""

    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        await watching.until(TORQUE, lambda state: state["value"] == 0)
        other = site.text.replace('unit = "Nm"', 'unit = "%"').format(port=site.port)
        await site.gateway.reload(parse_plant(other, site.file, load_profile))
        await watching.until(TORQUE, lambda state: (state["value"], state["unit"]) == (0, "%"))

    run(tmp_path, check, 'outbox = "outbox.db"')


def test_names_with_signs_of_their_own(tmp_path: Path) -> None:
    names = DEVICES.replace("device.infeed", 'device."a/b+c#%"')

    async def check(mosquitto: Broker) -> None:
        async with (
            published(tmp_path, tables(mosquitto.port), names),
            watcher(mosquitto) as watching,
        ):
            await watching.until("multidrop/a%2Fb%2Bc%23%25/torque")

    with broker(tmp_path) as mosquitto:
        asyncio.run(check(mosquitto))


def test_the_broker_is_killed_and_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has forgotten everything; the newest states are there again, and nothing older."""
    monkeypatch.setattr(mqtt, "LONGEST_PAUSE", 0.5)

    async def check(mosquitto: Broker) -> None:
        async with connected(tmp_path, mosquitto, devices=SLOW) as site:
            port = f"127.0.0.1:{mosquitto.port}"
            await site.read_now("infeed", "bus_address")
            async with watcher(mosquitto) as watching:
                await watching.until("multidrop/infeed/bus_address")
            await asyncio.to_thread(mosquitto.kill)
            await site.until(lambda: any("is away" in text for text in site.said))
            for value in (3, 4, 5):
                await site.gateway.write("infeed", "torque", value, who="test", origin="test")
                await site.until_value("infeed", "torque", value)
            await asyncio.to_thread(mosquitto.start)
            async with watcher(mosquitto) as watching:
                await watching.until("multidrop/status", lambda status: status == "online")
                await watching.until("multidrop/unwinder/tension")
                await watching.until(TORQUE, lambda state: state["value"] == 5)
                await watching.until("multidrop/infeed/bus_address", lambda s: s["value"] == 0)
                torques = [m for m in watching.messages if str(m.topic) == TORQUE]
                assert [json.loads(m.payload)["value"] for m in torques] == [5]
            said = [text for text in site.said if "mqtt" in text]
            assert said[0] == said[-1] == f"mqtt: connected to {port}"
            assert 3 <= len(said) <= 5  # away once for each reason, not for each attempt
            assert all(f"mqtt: {port} is away" in text for text in said[1:-1])

    with broker(tmp_path) as mosquitto:
        asyncio.run(check(mosquitto))


def test_a_gateway_that_stops_says_so(tmp_path: Path) -> None:
    async def check(mosquitto: Broker) -> None:
        async with watcher(mosquitto) as watching:
            async with connected(tmp_path, mosquitto):
                await watching.until("multidrop/status", lambda status: status == "online")
            await watching.until("multidrop/status", lambda status: status == "offline")

    with broker(tmp_path) as mosquitto:
        asyncio.run(check(mosquitto))


@pytest.mark.parametrize("step", ["__aenter__", "subscribe", "publish"])
def test_a_stop_that_is_lost_in_a_wait_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """Python 3.11's `wait_for` forgets a cancellation where what it waited for came just then."""
    waiting = asyncio.Event()
    done = getattr(aiomqtt.Client, step)

    async def forgetful(self: aiomqtt.Client, *arguments: Any, **options: Any) -> Any:
        found = await done(self, *arguments, **options)
        if not waiting.is_set() and (step != "publish" or options.get("qos")):
            waiting.set()
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.sleep(3600)
        return found

    monkeypatch.setattr(aiomqtt.Client, step, forgetful)

    async def main(mosquitto: Broker) -> None:
        async with asyncio.timeout(PATIENCE):
            async with published(tmp_path, tables(mosquitto.port)):
                await waiting.wait()

    with broker(tmp_path) as mosquitto:
        asyncio.run(main(mosquitto))


def test_a_gateway_that_is_killed_is_offline_and_gets_no_command_later(
    tmp_path: Path, audit: Path
) -> None:
    """By its last will; and what was sent while it was away is not kept for it."""
    file = tmp_path / "multidrop.toml"

    async def check(mosquitto: Broker, port: str) -> None:
        file.write_text(tables(mosquitto.port, "commands = true") + DEVICES.format(port=port))
        async with watcher(mosquitto) as watching:
            with contextlib.closing(_Run(file)) as first:
                await watching.until("multidrop/status", lambda status: status == "online")
                await watching.until(TORQUE)
                await watching.command("7")
                assert (await watching.answer())["outcome"] == "confirmed"
                first.kill()
                await watching.until("multidrop/status", lambda status: status == "offline")
            await watching.command("8", expiry=10)
            with contextlib.closing(_Run(file)):
                await watching.until("multidrop/status", lambda status: status == "online")
                await watching.command("9")
                assert (await watching.answer())["asked"] == 9
        assert [line["asked"] for line in logged(audit)] == [7, 9]

    with simulated("flexmax:0", "ax-v:2") as address, broker(tmp_path) as mosquitto:
        asyncio.run(check(mosquitto, address.port))


class _Run(Running):
    """`multidrop run`."""

    def __init__(self, file: Path) -> None:
        super().__init__(COMMAND, "run", str(file))

    def kill(self) -> None:
        self.process.kill()

    def close(self) -> None:
        self.end()


def test_what_the_broker_has_of_another_day_is_gone_before_the_gateway_is_online(
    tmp_path: Path,
) -> None:
    """Even of a point that is not read for hours."""

    async def check(mosquitto: Broker) -> None:
        place = "multidrop/infeed/bus_address"
        async with watcher(mosquitto) as watching:
            old = json.dumps({"value": 99, "unit": None, "quality": "good", "time": "2026-01-01"})
            await watching.client.publish(place, old, qos=1, retain=True)
            await watching.until(place, lambda state: state["value"] == 99)
            async with published(tmp_path, tables(mosquitto.port), SLOW) as site:
                site.line.devices.clear()
                await watching.until("multidrop/status", lambda status: status == "online")
                topics = [str(message.topic) for message in watching.messages]
                assert topics.index("multidrop/status") > topics.index(place, 1)
                assert json.loads(watching.seen[place])["value"] is None

    with broker(tmp_path) as mosquitto:
        asyncio.run(check(mosquitto))


# -- commands --------------------------------------------------------------------------------


def test_a_command_is_carried_out_and_answered(tmp_path: Path, audit: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        await watching.command("123")
        assert await watching.answer() == {
            "v": 1,
            "device": "infeed",
            "point": "torque",
            "old": 0,
            "asked": 123,
            "found": 123,
            "outcome": "confirmed",
        }
        await watching.until(TORQUE, lambda state: state["value"] == 123)
        (line,) = logged(audit)
        assert (line["who"], line["from"]) == ("mqtt client", f"mqtt 127.0.0.1:{mosquitto.port}")
        assert (line["old"], line["found"], line["outcome"]) == (0, 123, "confirmed")

        await watching.command("12.5", "multidrop/unwinder/tension/set", response=None)
        await watching.until("multidrop/unwinder/tension", lambda state: state["value"] == 12.5)

    run(tmp_path, check, "commands = true")


def test_mosquitto_rr_asks_and_is_answered(tmp_path: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        program, port = found("mosquitto_rr"), str(mosquitto.port)
        expiry = ("-D", "PUBLISH", "message-expiry-interval", "5")
        topics = ("-t", SET, "-e", "answers/rr")
        status, out = await ran(
            program, "-V", "5", "-p", port, "-W", "10", *topics, *expiry, "-m", "321"
        )
        assert status == 0, out
        assert json.loads(out)["found"] == 321

    run(tmp_path, check, "commands = true")


@pytest.mark.parametrize(
    ("payload", "how", "said"),
    [
        ("5", {"expiry": None}, "it has no message expiry, of at most 10 s"),
        ("5", {"expiry": 11}, "its message expiry is 11 s, and 10 s is the most"),
        ("5", {"retain": True}, "it is a retained message, which may be of any time"),
        ("5", {"topic": "multidrop/infeed/torqu/set"}, "is the topic of no point"),
        ("", {}, "'' is not a number, true or false"),
        ("NaN", {}, "'NaN' is not a number, true or false"),
        ("1e999", {}, "'1e999' is not a number, true or false"),
        ('"5"', {}, "is not a number, true or false"),
        ("[5]", {}, "'[5]' is not a number, true or false"),
        ("[" * 5000, {}, "is not a number, true or false"),
        ("5" * 5000, {}, "is not a number, true or false"),
        ("1501", {}, "1501"),
        ("5", {"topic": "multidrop/infeed/speed/set"}, "may not be written"),
    ],
)
def test_what_is_refused_is_logged_and_answered(
    tmp_path: Path, audit: Path, payload: str, how: dict[str, Any], said: str
) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        await watching.command(payload, **how)
        answer = await watching.answer()
        assert answer["outcome"] == "not-sent"
        assert answer["error"]["kind"] == "usage"
        assert said in answer["error"]["text"]
        (line,) = logged(audit)
        assert line["outcome"] == "not-sent"
        assert line["error"] == answer["error"]["text"]

    run(tmp_path, check, "commands = true")


def test_a_command_that_was_retained_before_is_refused(tmp_path: Path, audit: Path) -> None:
    """A machine must not start because a gateway came back."""

    async def check(mosquitto: Broker) -> None:
        async with watcher(mosquitto) as watching:
            await watching.command("5", expiry=10, retain=True)
            async with connected(tmp_path, mosquitto, "commands = true"):
                assert "retained" in (await watching.answer())["error"]["text"]
        (line,) = logged(audit)
        assert (line["asked"], line["outcome"]) == ("5", "not-sent")

    with broker(tmp_path) as mosquitto:
        asyncio.run(check(mosquitto))


@pytest.mark.parametrize(
    "response",
    ["multidrop/infeed/torque", "multidrop/unwinder/tension/set", "homeassistant/x", "$x"],
)
def test_nobody_has_an_answer_put_where_others_read(
    tmp_path: Path, audit: Path, response: str
) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        await watching.command("5", response=response)
        await watching.command("6")
        assert (await watching.answer())["found"] == 6
        assert [line["outcome"] for line in logged(audit)] == ["not-sent", "confirmed"]
        assert "is no topic for an answer" in logged(audit)[0]["error"]
        assert all(
            message.topic.value != response or message.payload.startswith(b'{"value"')
            for message in watching.messages
        )

    run(tmp_path, check, "commands = true", 'discovery = "homeassistant"')


def test_a_command_that_fails_says_how(tmp_path: Path, audit: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        await watching.command("5", "multidrop/unwinder/missing/set")
        answer = await watching.answer()
        assert (answer["outcome"], answer["error"]["kind"]) == ("not-applied", "refused")
        assert isinstance(answer["error"]["code"], int)
        site.line.devices.clear()
        await watching.command("5")
        answer = await watching.answer()
        assert (answer["outcome"], answer["error"]["kind"]) == ("not-sent", "no-reply")
        assert len(logged(audit)) == 2

    run(tmp_path, check, "commands = true")


def test_a_command_that_waited_too_long_is_not_begun(tmp_path: Path, audit: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        site.answer_delay(0.25)  # three messages for each write, and polls between them
        for value in range(1, 8):
            await watching.command(str(value), expiry=1 if value > 1 else 10)
        outcomes = [await watching.answer() for _ in range(7)]
        late = [answer for answer in outcomes if answer["outcome"] == "not-sent"]
        assert outcomes[0]["outcome"] == "confirmed"
        assert late
        assert all("expired" in answer["error"]["text"] for answer in late)
        assert len(logged(audit)) == 7

    run(tmp_path, check, "commands = true")


def test_a_command_does_not_wait_behind_what_is_taken_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its time counts from when it came: it must not be new only because nobody had looked at it before."""
    real = mqtt_broker.Client.publish

    async def slow(client: aiomqtt.Client, topic: str, payload: Any = None, **more: Any) -> None:
        if isinstance(payload, bytes) and not payload:
            await asyncio.Event().wait()
        await real(client, topic, payload, **more)

    async def check(mosquitto: Broker) -> None:
        async with watcher(mosquitto) as watching:
            await watching.client.publish("multidrop/old/point", "{}", qos=1, retain=True)
            monkeypatch.setattr(mqtt_broker.Client, "publish", slow)
            async with connected(tmp_path, mosquitto, "commands = true"):
                await watching.until(TORQUE, lambda state: state["value"] == 0)
                await watching.command("5")
                assert (await watching.answer())["found"] == 5

    with broker(tmp_path) as mosquitto:
        asyncio.run(check(mosquitto))


def test_commands_too_many_at_once_are_refused(
    tmp_path: Path, audit: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(carrying_out, "MOST_AT_ONCE", 1)

    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        site.answer_delay(0.1)
        await watching.command("1")
        await watching.command("2", "multidrop/unwinder/tension/set")
        answers = [await watching.answer() for _ in range(2)]
        by_device = {answer["device"]: answer for answer in answers}
        assert by_device["infeed"]["outcome"] == "confirmed"
        assert by_device["unwinder"]["error"]["text"] == "1 commands are under way already"
        assert len(logged(audit)) == 2

    run(tmp_path, check, "commands = true")


def test_commands_are_off_unless_the_plant_says_so(tmp_path: Path, audit: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        await watching.command("5")
        await watching.until("multidrop/unwinder/tension")
        await site.gateway.write("infeed", "torque", 6, who="test", origin="test")
        await watching.until(TORQUE, lambda state: state["value"] == 6)
        assert [line["asked"] for line in logged(audit)] == [6]

    run(tmp_path, check)


# -- Home Assistant, and what is no more ----------------------------------------------------------


def test_home_assistant_is_told_of_every_point(tmp_path: Path) -> None:
    async def check(site: Published, mosquitto: Broker, watching: Watcher) -> None:
        place = "homeassistant/sensor/multidrop_multidrop/multidrop-unwinder-tension/config"
        async with watcher(mosquitto, "homeassistant/#") as other:
            told = await other.until(place)
            assert told["state_topic"] == "multidrop/unwinder/tension"
            assert told["unit_of_measurement"] == "N"
            assert told["unique_id"] == "multidrop-unwinder-tension"
            assert told["value_template"] == "{{ value_json.value }}"
            assert [item["topic"] for item in told["availability"]] == [
                "multidrop/status",
                "multidrop/unwinder/tension",
            ]
            assert told["device"]["identifiers"] == ["multidrop-unwinder"]
            assert "command_topic" not in told
            (kept,) = await subscribed(mosquitto, "-t", place, "-C", "1", "-F", "%r")
            assert kept == "1"

            # a reload takes back what is no more
            rest = DEVICES.replace("tension =", "pull =")
            site.text = site.text.replace(DEVICES, rest)
            await site.gateway.reload(site.plant())
            await other.until(place, lambda payload: payload == "")
            await other.until(place.replace("tension", "pull"))
            await watching.until("multidrop/unwinder/tension", lambda payload: payload == "")
            await watching.until("multidrop/unwinder/pull", lambda state: state["value"] == 12.5)

    run(tmp_path, check, 'discovery = "homeassistant"')


def test_what_an_earlier_gateway_left_behind_is_taken_back(tmp_path: Path) -> None:
    async def check(mosquitto: Broker) -> None:
        gone = "homeassistant/sensor/multidrop_multidrop/multidrop-old-point/config"
        other = "homeassistant/sensor/other/old/config"
        async with watcher(mosquitto, "#") as watching:
            for topic in ("multidrop/old/point", gone, other):
                await watching.client.publish(topic, "{}", qos=1, retain=True)
            async with connected(tmp_path, mosquitto, 'discovery = "homeassistant"'):
                await watching.until("multidrop/old/point", lambda payload: payload == "")
                await watching.until(gone, lambda payload: payload == "")
                await watching.until("multidrop/unwinder/tension")
                kept = await subscribed(
                    mosquitto, "-t", "#", "--retained-only", "-W", "1", "-F", "%t"
                )
        assert other in kept
        assert TORQUE in kept
        assert "homeassistant/sensor/multidrop_multidrop/multidrop-infeed-torque/config" in kept
        assert gone not in kept

    with broker(tmp_path) as mosquitto:
        asyncio.run(check(mosquitto))


# -- who may connect ------------------------------------------------------------------------------

SECRET = "correct horse"


@pytest.fixture
def guarded(tmp_path: Path) -> list[str]:
    """Lines of a broker that knows one user."""
    passwords = tmp_path / "passwords"
    program = found("mosquitto_passwd")
    subprocess.run([program, "-b", "-c", str(passwords), "press", SECRET], check=True)
    passwords.chmod(0o644)
    return ["allow_anonymous false", f"password_file {passwords}"]


def test_user_and_password(
    tmp_path: Path, guarded: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def check(mosquitto: Broker) -> None:
        user = 'user = "press"'
        (tmp_path / "password.txt").write_text(f"{SECRET}\nnot this\n")
        async with connected(tmp_path, mosquitto, user, 'password = "password.txt"') as site:
            assert not any(SECRET in text for text in site.said)
        monkeypatch.setenv("MULTIDROP_MQTT_PASSWORD", SECRET)
        async with connected(tmp_path, mosquitto, user):
            pass
        monkeypatch.setenv("MULTIDROP_MQTT_PASSWORD", "wrong horse")
        async with published(tmp_path, tables(mosquitto.port, user)) as site:
            await site.until(lambda: bool(site.said))
            assert "is away" in site.said[0]
            assert "horse" not in site.said[0]

    with broker(tmp_path, *guarded) as mosquitto:
        asyncio.run(check(mosquitto))


def certificate(folder: Path, name: str) -> Path:
    """A certificate that vouches for itself, and its key."""
    path = folder / f"{name}.pem"
    files = ["-keyout", str(folder / f"{name}.key"), "-out", str(path)]
    subject = ["-subj", f"/CN={name}", "-addext", "subjectAltName=IP:127.0.0.1"]
    command = [found("openssl"), "req", "-x509", "-newkey", "ec", "-pkeyopt"]
    subprocess.run(
        [*command, "ec_paramgen_curve:P-256", "-nodes", "-days", "2", *files, *subject],
        check=True,
        capture_output=True,
    )
    return path


@pytest.mark.filterwarnings("ignore:unclosed <ssl.SSLSocket:ResourceWarning")
def test_tls_and_a_broker_that_is_somebody_else(tmp_path: Path) -> None:
    own, other = certificate(tmp_path, "own"), certificate(tmp_path, "other")
    key = tmp_path / "own.key"
    settings = ["allow_anonymous true", f"certfile {own}", f"keyfile {key}"]

    async def check(mosquitto: Broker) -> None:
        async with connected(tmp_path, mosquitto, "tls = true", f'authority = "{own}"'):
            pass
        wrong = tables(mosquitto.port, "tls = true", f'authority = "{other}"')
        async with published(tmp_path, wrong) as site:
            await site.until(lambda: bool(site.said))
            assert "certificate verify failed" in site.said[0]
        gc.collect()  # the client library leaves it to this to close a socket that got no TLS

    with broker(tmp_path, *settings) as mosquitto:
        asyncio.run(check(mosquitto))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (['topic = "a/#"'], "which is no first part of topics"),
        (['topic = ""'], "which is no first part of topics"),
        (['topic = "$SYS"'], "which is no first part of topics"),
        (['discovery = "a+"'], "mqtt.discovery is 'a+'"),
        (['password = "nowhere"', 'user = "x"'], "No such file"),
        (['password = "nowhere"'], "mqtt.password is given, but no user"),
        (["tls = true", 'authority = "nowhere"'], "No such file"),
        (["tls = true", 'authority = "multidrop.toml"'], "mqtt.authority"),
        (['password = "multidrop.toml"', 'user = "x"'], "its first line is empty"),
        (['authority = "nowhere"'], "but not tls = true"),
    ],
)
def test_settings_that_cannot_be_are_refused_at_the_start(
    tmp_path: Path, more: list[str], said: str
) -> None:
    (tmp_path / "multidrop.toml").write_text("\n")

    async def check() -> None:
        async with published(tmp_path, tables(1, *more)):
            pass

    with pytest.raises(UsageError, match=re.escape(said)):
        asyncio.run(check())


@pytest.mark.parametrize("place", ['host = ""\nport = 1883', 'host = "x"\nport = 65536'])
def test_a_broker_that_can_be_nowhere_is_refused(tmp_path: Path, place: str) -> None:
    async def check() -> None:
        async with published(tmp_path, f"[mqtt]\n{place}\n"):
            pass

    with pytest.raises(UsageError, match="there is no broker at"):
        asyncio.run(check())


def test_a_password_that_goes_over_a_network_in_clear_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MULTIDROP_MQTT_PASSWORD", SECRET)
    monkeypatch.setattr(mqtt_broker.Broker, "client", _nowhere)

    async def said(host: str, *more: str) -> list[str]:
        text = "\n".join(["[mqtt]", f'host = "{host}"', 'user = "press"', *more, ""])
        async with published(tmp_path, text) as site:
            await site.until(lambda: any("is away" in text for text in site.said))
            return [text for text in site.said if "unencrypted" in text]

    warned = "mqtt: the password goes to broker.example:1883 unencrypted: set tls = true"
    assert asyncio.run(said("broker.example")) == [warned]
    assert asyncio.run(said("broker.example", "tls = true")) == []
    assert asyncio.run(said("127.0.0.1")) == []


def _nowhere(self: object, status: str) -> aiomqtt.Client:
    raise aiomqtt.MqttError("nobody there")
