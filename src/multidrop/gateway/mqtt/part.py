"""The gateway's MQTT side: states to a broker, commands from it. docs/reference/mqtt.md says how.

While the broker is away only the newest state of each point waits, or with an `outbox` all of
them. Every connection is a new session: the broker keeps no command for a gateway that is not there.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from itertools import islice
from typing import TYPE_CHECKING

from multidrop.gateway.gateway import Gateway
from multidrop.gateway.mqtt.broker import (
    AT_ONCE,
    FRESH,
    KEPT,
    Broker,
    aiomqtt,
    command_of,
    end_all,
    end_if_cancelled,
    publish_together,
    subscribe,
    wrong_with_broker,
)
from multidrop.gateway.mqtt.carrying_out import Commands
from multidrop.gateway.mqtt.outbox import backlog_of, wrong_with_outbox
from multidrop.gateway.mqtt.telling import MqttState, away, in_memory, metrics_of
from multidrop.gateway.mqtt.topics import (
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
from multidrop.gateway.settings import Settings, objections
from multidrop.gateway.telling import Metric, Trouble
from multidrop.gateway.values import Key, Update
from multidrop.plant import Plant

if TYPE_CHECKING:
    from multidrop.gateway.settings import MqttSettings

FIRST_PAUSE, LONGEST_PAUSE = 0.5, 30.0
"""s between attempts to connect: twice as long each time."""

STEADY = 5.0
"""s after which a connection was one, and not an attempt that failed."""

FAREWELL = 1.0
"""s in which the broker is told that the gateway stops."""

TOGETHER = 0.01
"""s in which states gather behind some that were sent; the first after a quiet while waits for none."""


def part(gateway: Gateway) -> Mqtt:
    """The part of a gateway whose plant file has an `[mqtt]`. Raises `UsageError`."""
    assert gateway.settings.mqtt is not None
    return Mqtt(gateway, gateway.settings.mqtt)


def wrong(plant: Plant, settings: Settings) -> Iterator[str]:
    """What is wrong with `[mqtt]`."""
    table = settings.mqtt
    assert table is not None
    yield from wrong_with_broker(table, settings.path)
    yield from objections(
        lambda: checked_topic(table.topic, "mqtt.topic"),
        lambda: table.discovery is None or checked_topic(table.discovery, "mqtt.discovery"),
    )
    yield from wrong_with_outbox(settings)


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
        self._error: str | None = "not connected yet"
        self._since = datetime.now(UTC)  # of the error
        self._backlog = backlog_of(gateway.settings, gateway.news)
        self._broker = Broker(settings, gateway.settings.path)
        self._plant = gateway.plant
        self._keys = {self.topics.state(key): key for key in keys_of(gateway.plant)}
        self._discovery = self._discovered()
        self._announced: dict[str, str] = {}
        self._published: dict[Key, Update] = {}
        self._waiting: dict[Key, Update] = {}
        self._wake = asyncio.Event()
        self._commands = Commands(gateway, settings, self.topics, f"mqtt {self._broker}")

    @property
    def state(self) -> MqttState:
        """How it is with the broker."""
        backlog = self._backlog
        if backlog is None:
            return MqttState(self._error)
        return MqttState(self._error or backlog.error, backlog.waiting, backlog.hours)

    @property
    def trouble(self) -> Trouble | None:
        """Why states are not where they should be, if they are not."""
        backlog, state = self._backlog, self.state
        if backlog is not None and backlog.error is not None and backlog.since is not None:
            return in_memory(replace(state, error=backlog.error), backlog.since)
        if self._error is None:
            return None
        left = None if backlog is None else backlog.left
        return away(str(self._broker), state, self._since, left)

    def metrics(self) -> Iterable[Metric]:
        return metrics_of(self.state)

    async def run(self) -> None:
        """Until cancelled; what waits in memory then goes to the disk."""
        async with self._backlog or contextlib.nullcontext():
            self.gateway.values.listeners.append(self._take)
            try:
                await self._connect_again()
            finally:
                self.gateway.values.listeners.remove(self._take)

    async def _connect_again(self) -> None:
        """Connect, publish, and connect again when the broker was away."""
        now = asyncio.get_running_loop().time
        if self._broker.gives_away:
            self.gateway.say(
                f"mqtt: the password goes to {self._broker} unencrypted: set tls = true"
            )
        pause, said = FIRST_PAUSE, ""
        while True:
            try:
                async with self._broker.client(self.topics.status) as client:
                    self.connected_at, self._error = now(), None
                    await self._serve(client)
            except aiomqtt.MqttError as error:
                if self._error is None:
                    self._since = datetime.now(UTC)
                self._error = reason = str(error)
            if self.connected_at is not None and now() - self.connected_at > STEADY:
                pause, said = FIRST_PAUSE, ""
            self.connected_at = None
            if self._backlog is not None:
                await self._backlog.put_back()
            if reason != said:
                said = reason
                waits = f"; {self._backlog}" if self._backlog is not None else ""
                self.gateway.say(f"mqtt: {self._broker} is away: {reason}{waits}")
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    async def _serve(self, client: aiomqtt.Client) -> None:
        """One connection to its end. Raises `MqttError` where the broker has gone."""
        end_if_cancelled()
        self._announced.clear()
        if self._backlog is None:
            self._published.clear()
            self._waiting = dict(self.gateway.values.latest)
        self._wake.set()
        orphans: asyncio.Queue[str] = asyncio.Queue()
        tasks = [
            asyncio.create_task(self._listen(client, orphans)),
            asyncio.create_task(self._take_back(client, orphans)),
            asyncio.create_task(self._publish(client)),
        ]
        self.gateway.say(f"mqtt: connected to {self._broker}")
        try:
            ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in ended:
                task.result()
        except asyncio.CancelledError:
            await self._commands.end(FAREWELL)
            with contextlib.suppress(aiomqtt.MqttError):
                await client.publish(
                    self.topics.status, OFFLINE, qos=1, retain=True, timeout=FAREWELL
                )
            raise
        finally:
            await end_all(tasks)

    # -- states ------------------------------------------------------------------------------

    def _take(self, update: Update) -> None:
        """A listener of `Values`: what is new waits, in the place of what waited before or behind it."""
        key = update.key
        changed, news = self._has_changed(), self._is_news(key, update)
        if self._backlog is not None and news:
            self._published[key] = update
            self._backlog.add(self.topics.state(key), update)
        elif self._backlog is None and (news or changed):
            self._waiting[key] = update
        if news or changed:
            self._wake.set()

    def _is_news(self, key: Key, update: Update) -> bool:
        """Whether it differs from what the broker has by the dead band, or that is old."""
        if key in self._waiting:
            return True
        before, polled = self._published.get(key), update.polled
        if before is None or before.polled.quality is not polled.quality:
            return True
        if before.polled.point is not polled.point and before.polled.point != polled.point:
            return True  # after a reload it is another: the same number means something else
        if update.monotonic - before.monotonic >= self.settings.longest:
            return True
        one, other = before.polled.value, polled.value
        if one == other or not polled.good:
            return False
        if isinstance(one, int | float) and isinstance(other, int | float):
            device = self.gateway.plant.devices.get(update.device)
            known = device.points.get(update.point) if device is not None else None
            return known is None or not abs(one - other) < known.deadband
        return True

    async def _publish(self, client: aiomqtt.Client) -> None:
        """First what the broker has of another day is replaced, and only then the gateway is online."""
        await self._subscribe(client)
        await self._send_waiting(client)
        for topic, key in self._keys.items():
            if key not in self.gateway.values.latest:
                await client.publish(topic, unread_payload(self._plant, key), retain=True)
        end_if_cancelled()
        self._repeat_others()
        await self._send_waiting(client)
        await self._announce(client)
        await client.publish(self.topics.status, ONLINE, qos=1, retain=True)
        if self._backlog is not None and self._backlog.followed:
            self.gateway.say(f"mqtt: {self._backlog.followed} states that had waited have followed")
        while True:
            end_if_cancelled()
            await self._wake.wait()
            self._wake.clear()
            await self._send_waiting(client)
            await asyncio.sleep(TOGETHER)

    def _repeat_others(self) -> None:
        """The newest of each point that did not wait: a broker may have forgotten what it had."""
        if self._backlog is None:
            return
        for key, update in self.gateway.values.latest.items():
            topic = self.topics.state(key)
            if topic in self._keys and topic not in self._backlog.confirmed:
                self._published[key] = update
                self._backlog.add(topic, update)

    def _has_changed(self) -> bool:
        """Whether the plant file was read again."""
        return self._plant is not self.gateway.plant

    async def _send_waiting(self, client: aiomqtt.Client) -> None:
        """What waits now; what comes meanwhile gathers for the next time."""
        while True:
            if self._has_changed():
                await self._change(client)
            if self._backlog is None:
                await self._send_newest(client)
            else:
                await self._backlog.deliver(client, self.topics, self._keys, self._has_changed)
            if not self._has_changed():
                return

    async def _send_newest(self, client: aiomqtt.Client) -> None:
        """Together: one alone costs several times as much of the loop."""
        while self._waiting and not self._has_changed():
            states: list[tuple[str, str, bool]] = []
            keys = list(islice(self._waiting, AT_ONCE))
            for key in keys:
                update = self._waiting.pop(key)
                topic = self.topics.state(key)
                if topic in self._keys:
                    self._published[key] = update
                    states.append((topic, state_payload(update), True))
            await publish_together(client, states)
            if len(keys) < AT_ONCE:
                return
            await asyncio.sleep(0)  # publishing may not wait, and others want to run

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

    async def _listen(self, client: aiomqtt.Client, orphans: asyncio.Queue[str]) -> None:
        """Commands, and what the broker has kept of points that there are no more.

        From the first moment on: this is what notices that the broker has gone. It waits for
        nothing else: a command's time counts from here, and must not begin when it is old.
        """
        async for message in client.messages:
            topic = str(message.topic)
            if self.settings.commands and self.topics.is_command(topic):
                key = self._keys.get(topic.removesuffix("/set"))
                self._commands.begin(client, command_of(topic, message), key)
            elif message.retain and message.payload and self._is_orphan(topic):
                orphans.put_nowait(topic)

    async def _take_back(self, client: aiomqtt.Client, orphans: asyncio.Queue[str]) -> None:
        while True:
            topic = await orphans.get()
            if self._is_orphan(topic):  # it may have come back with a reload
                await client.publish(topic, b"", qos=1, retain=True)
            end_if_cancelled()

    def _is_orphan(self, topic: str) -> bool:
        """Whether what the broker has kept there is of a point that was."""
        return topic not in self._keys and topic not in self._discovery
