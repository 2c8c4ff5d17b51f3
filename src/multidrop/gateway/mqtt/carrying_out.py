"""Commands that came over MQTT, until they are answered: those to a device one after the other."""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING

from multidrop.errors import Error, UsageError
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.mqtt.broker import aiomqtt, answer_properties
from multidrop.gateway.mqtt.commands import Command, done, failed, may_answer
from multidrop.gateway.mqtt.topics import Topics
from multidrop.gateway.values import Key
from multidrop.writing import Written

if TYPE_CHECKING:
    from multidrop.gateway.settings import MqttSettings

MOST_AT_ONCE = 32
"""Commands that are under way; what comes beyond is refused."""

WHO = "mqtt client"


class Commands:
    """Those that are under way. `origin` is where they come from, for the log."""

    def __init__(
        self, gateway: Gateway, settings: MqttSettings, topics: Topics, origin: str
    ) -> None:
        self._gateway = gateway
        self._settings = settings
        self._topics = topics
        self._told = {"who": WHO, "origin": origin}
        self._under_way: set[asyncio.Task[None]] = set()
        self._turns: dict[str, asyncio.Lock] = {}

    def begin(self, client: aiomqtt.Client, command: Command, key: Key | None) -> None:
        """Carry out a command to the point of this key, None where its topic is no point's."""
        task = asyncio.create_task(self._answer(client, command, key))
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)

    async def end(self, within: float) -> None:
        """Wait so many s for those that are under way."""
        if self._under_way:
            await asyncio.wait(self._under_way, timeout=within)

    async def _answer(self, client: aiomqtt.Client, command: Command, key: Key | None) -> None:
        """Carry out a command, and say what came of it where that is wanted."""
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
                self._gateway.refuse(device, point, command.text, str(error), **self._told)
                raise
            return await self._gateway.write(device, point, value, **self._told)

    def _refusal(self, command: Command, key: Key | None) -> str | None:
        """Why a command is not carried out, whatever it says."""
        if key is None:
            return f"{command.topic} is the topic of no point"
        if command.response is not None and not self._may_answer(command.response):
            return f"{command.response!r} is no topic for an answer"
        if len(self._under_way) > MOST_AT_ONCE:
            return f"{MOST_AT_ONCE} commands are under way already"
        return command.refusal()

    def _may_answer(self, response: str) -> bool:
        return may_answer(response, self._topics.base, self._settings.discovery)
