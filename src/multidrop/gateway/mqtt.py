"""The gateway's MQTT side: states to a broker, commands from it. docs/reference/mqtt.md says how.

While the broker is away only the newest state of each point waits. Every connection is a
new session: the broker keeps no command for a gateway that is not there.
"""

from __future__ import annotations

import asyncio
import contextlib
from itertools import islice
from typing import TYPE_CHECKING

from multidrop.errors import Error, UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.mqtt_broker import (
    FRESH,
    KEPT,
    Broker,
    aiomqtt,
    answer_properties,
    command_of,
    demand_wanted,
    end_all,
    hand_over,
    subscribe,
)
from multidrop.gateway.mqtt_commands import Command, done, failed, may_answer
from multidrop.gateway.mqtt_topics import (
    OFFLINE,
    ONLINE,
    Topics,
    checked_topic,
    discovery,
    discovery_filter,
    keys_of,
    state_payload,
    unread_payload,
)
from multidrop.gateway.values import Key, Update
from multidrop.writing import Written

if TYPE_CHECKING:
    from multidrop.gateway.settings import MqttSettings

FIRST_PAUSE, LONGEST_PAUSE = 0.5, 30.0
"""s between attempts to connect: twice as long each time."""

STEADY = 5.0
"""s after which a connection was one, and not an attempt that failed."""

FAREWELL = 1.0
"""s in which the broker is told that the gateway stops."""

MOST_AT_ONCE = 32
"""Commands that are under way; what comes beyond is refused."""

SOON = 0.01
"""s that states wait for others: to send some together costs half of sending each."""

TOGETHER = 25
"""States that are handed to the broker's client at once."""

WHO = "mqtt client"


def part(gateway: Gateway) -> Mqtt:
    """The part of a gateway whose plant file has an `[mqtt]`. Raises `UsageError`."""
    assert gateway.settings.mqtt is not None
    return Mqtt(gateway, gateway.settings.mqtt)


class Mqtt:
    """A part of the gateway."""

    name = "mqtt"

    def __init__(self, gateway: Gateway, settings: MqttSettings) -> None:
        self.gateway = gateway
        self.settings = settings
        self.topics = Topics(checked_topic(settings.topic, "mqtt.topic"))
        if settings.discovery is not None:
            checked_topic(settings.discovery, "mqtt.discovery")
        self.connected_at: float | None = None  # monotonic, s
        self._broker = Broker(settings, gateway.settings.path)
        self._plant = gateway.plant
        self._keys = {self.topics.state(key): key for key in keys_of(gateway.plant)}
        self._discovery = self._discovered()
        self._announced: dict[str, str] = {}
        self._published: dict[Key, Update] = {}
        self._waiting: dict[Key, Update] = {}
        self._wake = asyncio.Event()
        self._commands: set[asyncio.Task[None]] = set()
        self._turns: dict[str, asyncio.Lock] = {}

    async def run(self) -> None:
        """Until cancelled: connect, publish, and connect again when the broker was away."""
        now = asyncio.get_running_loop().time
        self.gateway.values.listeners.append(self._take)
        if self._broker.gives_away:
            self.gateway.say(
                f"mqtt: the password goes to {self._broker} unencrypted: set tls = true"
            )
        pause, said = FIRST_PAUSE, ""
        try:
            while True:
                try:
                    async with self._broker.client(self.topics.status) as client:
                        self.connected_at = now()
                        await self._serve(client)
                except aiomqtt.MqttError as error:
                    reason = str(error)
                if self.connected_at is not None and now() - self.connected_at > STEADY:
                    pause, said = FIRST_PAUSE, ""
                self.connected_at = None
                if reason != said:
                    said = reason
                    self.gateway.say(f"mqtt: {self._broker} is away: {reason}")
                await asyncio.sleep(pause)
                pause = min(2 * pause, LONGEST_PAUSE)
        finally:
            self.gateway.values.listeners.remove(self._take)

    async def _serve(self, client: aiomqtt.Client) -> None:
        """One connection to its end. Raises `MqttError` where the broker has gone."""
        demand_wanted()
        self._published.clear()
        self._announced.clear()
        self._waiting = dict(self.gateway.values.latest)
        self._wake.set()
        tasks = [
            asyncio.create_task(self._listen(client)),
            asyncio.create_task(self._publish(client)),
        ]
        self.gateway.say(f"mqtt: connected to {self._broker}")
        try:
            ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in ended:
                task.result()
        except asyncio.CancelledError:
            if self._commands:
                await asyncio.wait(self._commands, timeout=FAREWELL)
            with contextlib.suppress(aiomqtt.MqttError):
                await client.publish(
                    self.topics.status, OFFLINE, qos=1, retain=True, timeout=FAREWELL
                )
            raise
        finally:
            await end_all(tasks)

    # -- states ------------------------------------------------------------------------------

    def _take(self, update: Update) -> None:
        """A listener of `Values`: what is new waits, in the place of what waited before."""
        key = update.key
        if self._plant is not self.gateway.plant or self._is_news(key, update):
            self._waiting[key] = update
            self._wake.set()

    def _is_news(self, key: Key, update: Update) -> bool:
        """Whether it differs from what the broker has by the dead band, or that is old."""
        if key in self._waiting:
            return True
        before, polled = self._published.get(key), update.polled
        if before is None or before.polled.quality is not polled.quality:
            return True
        if update.monotonic - before.monotonic >= self.settings.longest:
            return True
        one, other = before.polled.value, polled.value
        if one == other or not polled.good:
            return False
        if isinstance(one, int | float) and isinstance(other, int | float):
            device = self._plant.devices.get(update.device)
            known = device.points.get(update.point) if device is not None else None
            return known is None or not abs(one - other) < known.deadband
        return True

    async def _publish(self, client: aiomqtt.Client) -> None:
        """First what the broker has of another day is replaced, and only then the gateway is online."""
        await self._subscribe(client)
        for topic, key in self._keys.items():
            if key not in self._waiting:
                await client.publish(topic, unread_payload(self._plant, key), retain=True)
        await self._send_waiting(client)
        await self._announce(client)
        await client.publish(self.topics.status, ONLINE, qos=1, retain=True)
        while True:
            await self._wake.wait()
            await asyncio.sleep(SOON)
            self._wake.clear()
            if self._plant is not self.gateway.plant:
                await self._change(client)
            await self._send_waiting(client)

    async def _send_waiting(self, client: aiomqtt.Client) -> None:
        """The oldest first, some at a time: between them others want to run.

        At the end of all that waited the client is waited for, so that no more than that is in it.
        """
        while self._waiting:
            for left in range(len(self._waiting), 0, -TOGETHER):
                states = self._take_states(min(TOGETHER, left))
                if left > TOGETHER or not states:
                    hand_over(client, states)
                    await asyncio.sleep(0)
                else:
                    hand_over(client, states[:-1])
                    await client.publish(*states[-1], retain=True)

    def _take_states(self, count: int) -> list[tuple[str, str]]:
        """Topic and payload of the first that wait."""
        states = []
        for key in list(islice(self._waiting, count)):
            update = self._waiting.pop(key)
            topic = self.topics.state(key)
            if topic in self._keys:
                self._published[key] = update
                states.append((topic, state_payload(update)))
        return states

    async def _change(self, client: aiomqtt.Client) -> None:
        """After a reload: the states of points that are gone are taken back."""
        self._plant = self.gateway.plant
        before, self._keys = (
            self._keys,
            {self.topics.state(key): key for key in keys_of(self._plant)},
        )
        for topic, key in before.items():
            if topic not in self._keys:
                self._published.pop(key, None)
                await client.publish(topic, b"", qos=1, retain=True)
        self._discovery = self._discovered()
        await self._announce(client)

    def _discovered(self) -> dict[str, str]:
        prefix = self.settings.discovery
        return {} if prefix is None else discovery(self._plant, self.topics, prefix)

    async def _announce(self, client: aiomqtt.Client) -> None:
        for topic in self._announced.keys() - self._discovery.keys():
            await client.publish(topic, b"", qos=1, retain=True)
        for topic, payload in self._discovery.items():
            if self._announced.get(topic) != payload:
                await client.publish(topic, payload, qos=1, retain=True)
        self._announced = dict(self._discovery)

    # -- what comes --------------------------------------------------------------------------

    async def _subscribe(self, client: aiomqtt.Client) -> None:
        await subscribe(client, self.topics.states, KEPT)
        if self.settings.discovery is not None:
            place = discovery_filter(self.topics, self.settings.discovery)
            await subscribe(client, place, KEPT)
        if self.settings.commands:
            await subscribe(client, self.topics.commands, FRESH)

    async def _listen(self, client: aiomqtt.Client) -> None:
        """Commands, and what the broker has kept of points that there are no more.

        From the first moment on: this is what notices that the broker has gone.
        """
        async for message in client.messages:
            topic = str(message.topic)
            if self.settings.commands and self.topics.is_command(topic):
                self._begin(client, command_of(topic, message))
            elif message.retain and message.payload and self._is_orphan(topic):
                await client.publish(topic, b"", qos=1, retain=True)

    def _is_orphan(self, topic: str) -> bool:
        """Whether what the broker has kept there is of a point that was."""
        return topic not in self._keys and topic not in self._discovery

    def _begin(self, client: aiomqtt.Client, command: Command) -> None:
        task = asyncio.create_task(self._answer(client, command))
        self._commands.add(task)
        task.add_done_callback(self._commands.discard)

    async def _answer(self, client: aiomqtt.Client, command: Command) -> None:
        """Carry out a command, and say what came of it where that is wanted."""
        key = self._keys.get(command.topic.removesuffix("/set"))
        try:
            answer = done(key, await self._obey(command, key))
        except Error as error:
            answer = failed(key, command.text, error)
        if command.response is None or not self._may_answer(command.response):
            return
        properties = answer_properties(command.correlation)
        with contextlib.suppress(aiomqtt.MqttError):  # then the log has what came of it
            await client.publish(command.response, answer, qos=1, properties=properties)

    async def _obey(self, command: Command, key: Key | None) -> Written:
        """Commands to a device come one after the other. Raises what `Gateway.write` raises."""
        now = asyncio.get_running_loop().time
        until = now() + (command.expiry or 0)
        device, point = key or (command.topic, "")
        told = {"who": WHO, "origin": f"mqtt {self._broker}"}
        async with (
            self._turns.setdefault(device, asyncio.Lock()) if key else contextlib.nullcontext()
        ):
            try:
                why = self._refusal(command, key)
                if why is None and now() > until:
                    why = "it expired while others before it were carried out"
                if why is not None:
                    raise UsageError(why)
                value = command.number()
            except UsageError as error:
                self.gateway.refuse(device, point, command.text, str(error), **told)
                raise
            return await self.gateway.write(device, point, value, **told)

    def _refusal(self, command: Command, key: Key | None) -> str | None:
        """Why a command is not carried out, whatever it says."""
        if key is None:
            return f"{command.topic} is the topic of no point"
        if command.response is not None and not self._may_answer(command.response):
            return f"{command.response!r} is no topic for an answer"
        if len(self._commands) > MOST_AT_ONCE:
            return f"{MOST_AT_ONCE} commands are under way already"
        return command.refusal()

    def _may_answer(self, response: str) -> bool:
        return may_answer(response, self.topics.base, self.settings.discovery)
