"""The connection to a broker, as the plant file's `[mqtt]` describes it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import ssl
from collections.abc import Callable, Iterable, Iterator, Sequence
from ipaddress import ip_address
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from multidrop.errors import UsageError
from multidrop.gateway.mqtt.commands import Command
from multidrop.gateway.mqtt.topics import OFFLINE
from multidrop.gateway.settings import objections

try:
    import aiomqtt
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties
    from paho.mqtt.subscribeoptions import SubscribeOptions
except ImportError as missing:  # pragma: no cover - tried without the extra
    raise UsageError(
        f"[mqtt] needs {missing.name}, which is not installed: pip install 'multidrop[mqtt]'"
    ) from None

if TYPE_CHECKING:
    from multidrop.gateway.settings import MqttSettings

PASSWORD = "MULTIDROP_MQTT_PASSWORD"
"""Environment variable that has the password where no file is named."""

HIGHEST_PORT = 65535

KEEPALIVE = 15
"""s after which a broker that says nothing is asked whether it is there."""

TIMEOUT = 10.0
"""s in which the broker has to take or confirm something."""

AGAIN = 0.1
"""s after which a task that did not end is cancelled again."""

AT_ONCE = 32
"""States that are sent together: what else there is to do has its turn behind each lot."""

ANSWER_EXPIRY = 60
"""s that a broker keeps an answer for somebody who is away."""

QUIET = logging.getLogger("multidrop.mqtt")
QUIET.addHandler(logging.NullHandler())


class Client(aiomqtt.Client):
    """aiomqtt's, but it does not watch a socket that is closed, does not keep a broker waiting, nor waits for one that has hung up.

    A socket is closed by then where a write is the first to notice that the broker has gone:
    aiomqtt's own makes asyncio complain of that at length on standard error.
    """

    def _on_publish(self, client: Any, userdata: Any, mid: int, code: Any, facts: Any) -> None:
        if mid in self._pending_publishes:
            self._acknowledge()
        super()._on_publish(client, userdata, mid, code, facts)

    def _acknowledge(self) -> None:
        """A broker that gathers small packets sends its next confirmation when TCP has acknowledged this one.

        The system else does that 40 ms later, and has to be told each time.
        """
        sock: Any = self._client.socket()
        if sock is not None and hasattr(socket, "TCP_QUICKACK"):
            with contextlib.suppress(OSError):  # it may be closed
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)

    def _on_disconnect(
        self, client: Any, userdata: Any, flags: Any, code: Any, facts: Any = None
    ) -> None:
        """Before it has answered: aiomqtt's own waits for that answer until its time-out."""
        self._loop.call_soon_threadsafe(_hang_up, self._connected)
        super()._on_disconnect(client, userdata, flags, code, facts)

    def _on_socket_register_write(self, client: Any, userdata: Any, sock: Any) -> None:
        self._loop.call_soon_threadsafe(self._watch, client, sock)

    def _watch(self, client: Any, sock: Any) -> None:
        if sock.fileno() >= 0:
            self._loop.add_writer(sock.fileno(), self._write, client)

    def _write(self, client: Any) -> None:
        try:
            client.loop_write()
        except Exception as error:  # as aiomqtt's own: whatever it is, it ends the connection
            if not self._disconnected.done():
                self._disconnected.set_exception(error)


def _hang_up(connected: asyncio.Future[None]) -> None:
    if not connected.done():
        connected.set_exception(aiomqtt.MqttError("it hung up before it answered"))


class Broker:
    """Where a broker is, and what it takes to connect. Raises `UsageError` for what cannot be."""

    def __init__(self, settings: MqttSettings, place: Callable[[str], Path]) -> None:
        _demand_place(settings)
        self._settings = settings
        self._tls = _tls(settings, place)
        self._password = _password(settings, place)

    def __str__(self) -> str:
        return f"{self._settings.host}:{self._settings.port}"

    @property
    def gives_away(self) -> bool:
        """Whether a password goes over a network unencrypted."""
        return bool(self._password) and self._tls is None and not _loopback(self._settings.host)

    def client(self, status: str) -> aiomqtt.Client:
        """A client that is not connected yet; `status` is the topic of its last will.

        Its session ends with its connection.
        """
        session = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        session.SessionExpiryInterval = 0
        made = Client(
            self._settings.host,
            self._settings.port,
            username=self._settings.user,
            password=self._password,
            protocol=aiomqtt.ProtocolVersion.V5,
            clean_start=True,
            properties=session,
            will=aiomqtt.Will(status, OFFLINE, qos=1, retain=True),
            tls_context=self._tls,
            timeout=TIMEOUT,
            keepalive=KEEPALIVE,
            logger=QUIET,
            # else a state waits, up to 40 ms, until the broker's system acknowledges the one before
            socket_options=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
        )
        made.pending_calls_threshold = 2 * AT_ONCE  # each that is beyond costs a record of a log
        return made


KEPT = SubscribeOptions(qos=1, noLocal=True)
"""For what the broker keeps."""

FRESH = SubscribeOptions(qos=2, retainAsPublished=True)
"""As published: else the broker would hide that a message is a retained one."""


def end_if_cancelled() -> None:
    """Behind what aiomqtt waits for: Python 3.11's `wait_for` forgets that it was cancelled where that came just then."""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


async def subscribe(client: aiomqtt.Client, topic: str, options: SubscribeOptions) -> None:
    """Raises `MqttError` where the broker does not allow it."""
    codes = await client.subscribe(topic, options=options)
    for code in codes:
        if not isinstance(code, int) and code.is_failure:
            raise aiomqtt.MqttError(f"{topic} may not be subscribed to: {code}")


async def end_all(tasks: Sequence[asyncio.Task[Any]]) -> None:
    """Cancel tasks until they have ended.

    Once may not be enough: the client waits with `asyncio.wait_for`, which before Python
    3.12 swallows a cancellation that meets what it waits for.
    """
    while waiting := [task for task in tasks if not task.done()]:
        for task in waiting:
            task.cancel()
        await asyncio.wait(waiting, timeout=AGAIN)
    await asyncio.gather(*tasks, return_exceptions=True)


async def publish_together(
    client: aiomqtt.Client, messages: Iterable[tuple[str, str, bool]], qos: int = 0
) -> None:
    """Topic, payload, whether retained: in this order; `AT_ONCE` of them cost little more than a few.

    With a `qos` it returns when the broker has confirmed them all. Raises `MqttError` where
    it takes them no more.
    """
    tasks = [
        asyncio.ensure_future(client.publish(topic, payload, qos=qos, retain=retain, timeout=inf))
        for topic, payload, retain in messages
    ]
    try:
        # one time-out for all: each of its own would be a task and a timer
        async with asyncio.timeout(TIMEOUT):
            await asyncio.gather(*tasks)
    except TimeoutError:
        raise aiomqtt.MqttError("Operation timed out") from None
    finally:
        for task in tasks:  # where one has failed others may wait for ever
            task.cancel()


def command_of(topic: str, message: aiomqtt.Message) -> Command:
    """What of a message makes it a command."""
    facts = message.properties
    return Command(
        topic,
        bytes(message.payload),
        message.retain,
        getattr(facts, "MessageExpiryInterval", None),
        getattr(facts, "ResponseTopic", None),
        getattr(facts, "CorrelationData", None),
    )


def answer_properties(correlation: bytes | None) -> Properties:
    """Those of an answer to a command with this correlation data."""
    properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
    properties.MessageExpiryInterval = ANSWER_EXPIRY
    if correlation is not None:
        properties.CorrelationData = correlation
    return properties


def wrong_with_broker(settings: MqttSettings, place: Callable[[str], Path]) -> Iterator[str]:
    """What is wrong with where the broker is, and what it takes to connect."""
    return objections(
        lambda: _demand_place(settings),
        lambda: _tls(settings, place),
        lambda: _password(settings, place),
    )


def _demand_place(settings: MqttSettings) -> None:
    """Raises `UsageError` where nothing can be."""
    if not settings.host:
        raise UsageError("mqtt.host is empty: there is no broker at ''")
    if settings.port > HIGHEST_PORT:
        raise UsageError(
            f"mqtt.port is {settings.port}, and {HIGHEST_PORT} the highest: there is no broker at it"
        )


def _loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _tls(settings: MqttSettings, place: Callable[[str], Path]) -> ssl.SSLContext | None:
    """Raises `UsageError` where the authority's certificate cannot be used."""
    if not settings.tls:
        if settings.authority is not None:
            raise UsageError("mqtt.authority is given, but not tls = true")
        return None
    path = place(settings.authority) if settings.authority else None
    try:
        return ssl.create_default_context(cafile=path)
    except OSError as error:
        raise UsageError(f"mqtt.authority {path}: {error.strerror or error}") from None


def _password(settings: MqttSettings, place: Callable[[str], Path]) -> str | None:
    """Of the file, else of the environment. Raises `UsageError`."""
    if settings.password is None:
        return os.environ.get(PASSWORD) if settings.user is not None else None
    if settings.user is None:
        raise UsageError("mqtt.password is given, but no user")
    path: Path = place(settings.password)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise UsageError(f"mqtt.password {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"mqtt.password {path}: not UTF-8 text") from None
    if not lines or not lines[0]:
        raise UsageError(f"mqtt.password {path}: its first line is empty")
    return lines[0]


__all__ = [
    "AT_ONCE",
    "FRESH",
    "KEPT",
    "Broker",
    "aiomqtt",
    "answer_properties",
    "command_of",
    "end_all",
    "end_if_cancelled",
    "publish_together",
    "subscribe",
    "wrong_with_broker",
]
