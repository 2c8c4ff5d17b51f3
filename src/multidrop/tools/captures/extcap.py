"""What Wireshark asks of a program that captures for it, and the capturing: listening, never a byte sent.

Wireshark runs the program once for each question (which interfaces, which link
types, what may be set), reads sentences such as `value {arg=0}{value=slink3}`, and
at last runs it with the name of a FIFO to write a capture into.
"""

from __future__ import annotations

import os
import select
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import BinaryIO

from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.io.capture import RAW, CaptureWriter
from multidrop.io.list_ports import PortFacts
from multidrop.io.ports import PortSetup, open_port
from multidrop.naming import LineOptions
from multidrop.profile import nearest
from multidrop.protocols import PROTOCOLS
from multidrop.timing import LineSettings
from multidrop.tools.captures.listened import Listened
from multidrop.tools.captures.sniff import Sniffer

ANY_PORT = "multidrop"
"""The interface whose port is named in its settings; `multidrop-ttyUSB0` is that port."""

AUTO = "auto"
DEFAULT = "default"
"""What the protocol's documents say."""

RATES = (110, 300, 600, 1200, 2400, 4800, 9600, 14400, 19200, 28800, 38400, 57600, 115200)
FORMATS = ("8E1", "8N1", "8O1", "7E1", "7O1", "8N2")

Choices = Iterable[tuple[str, str]]  # value and what is shown


# -- what Wireshark asks ---------------------------------------------------------------------------


def interfaces(ports: Iterable[PortFacts]) -> list[str]:
    """The sentences that name this program and its interfaces."""
    lines = [_sentence("extcap", version=version("multidrop"), display="multidrop")]
    for port in ports:
        shown = f"multidrop: {port.device}, {port.adapter}"
        lines.append(_sentence("interface", value=_interface(port), display=shown))
    shown = "multidrop: a port of your choice"
    return [*lines, _sentence("interface", value=ANY_PORT, display=shown)]


def link_types() -> list[str]:
    """The sentences that name the link types of captures."""
    known = [(module.link_type, module.name) for module in PROTOCOLS.values()]
    return [
        _sentence("dlt", number=number, name=f"USER{number - known[0][0]}", display=name)
        for number, name in [*known, (RAW, "bytes of no known protocol")]
    ]


def settings(interface: str) -> list[str]:
    """The sentences for the dialogue in which an interface is set up."""
    dialogue = _Dialogue()
    if interface == ANY_PORT:
        dialogue.text("port", "Port", "such as /dev/ttyUSB0 or tcp://10.0.0.7:4001")
    protocols = [(AUTO, "told by what is heard"), *((name, name) for name in PROTOCOLS)]
    dialogue.choice("protocol", "Protocol", "what is spoken on the line", protocols)
    usual = [(DEFAULT, "as the protocol's documents say")]
    rates = [(str(rate), str(rate)) for rate in RATES]
    dialogue.choice("baud", "Baud rate", "bits per second", usual + rates)
    formats = [(name, name) for name in FORMATS]
    dialogue.choice("format", "Format", "data bits, parity, stop bits", usual + formats)
    switch = [("on", "on"), ("off", "off")]
    dialogue.choice("stuffing", "Byte stuffing", "of a Datalink line", usual + switch)
    return dialogue.lines


@dataclass(slots=True)
class _Dialogue:
    """Arguments are numbered, and their values refer to the number."""

    lines: list[str] = field(default_factory=list)
    _arguments: int = 0

    def text(self, key: str, shown: str, tip: str) -> None:
        self._argument(key, shown, tip, "string", required="true")

    def choice(self, key: str, shown: str, tip: str, values: Choices) -> None:
        """The first value is the default."""
        number = self._arguments
        self._argument(key, shown, tip, "selector")
        for place, (value, text) in enumerate(values):
            default = "false" if place else "true"
            sentence = _sentence("value", arg=number, value=value, display=text, default=default)
            self.lines.append(sentence)

    def _argument(self, key: str, shown: str, tip: str, kind: str, **more: str) -> None:
        facts = {"number": self._arguments, "call": f"--{key}", "display": shown, "tooltip": tip}
        self.lines.append(_sentence("arg", **facts, type=kind, **more))
        self._arguments += 1


def _sentence(word: str, **facts: object) -> str:
    """`word {key=value}...`; braces would end a value."""
    cleaned = {key: str(value).translate(_NO_BRACES) for key, value in facts.items()}
    return f"{word} " + "".join(f"{{{key}={value}}}" for key, value in cleaned.items())


_NO_BRACES = str.maketrans("{}", "()")


def _interface(port: PortFacts) -> str:
    return f"{ANY_PORT}-{os.path.basename(port.device)}"


def port_of(interface: str, ports: Iterable[PortFacts], given: str) -> str:
    """The port of an interface. Raises `UsageError`."""
    if interface == ANY_PORT:
        if not given:
            raise UsageError("which port? --port /dev/ttyUSB0, or --port tcp://HOST:PORT")
        if "://" in given and not given.startswith("tcp://"):
            raise UsageError(f"{given!r}: one can listen at a serial port here, or at tcp://")
        return given
    known = {_interface(port): port.device for port in ports}
    if interface not in known:
        raise UsageError(
            f"there is no interface {interface!r}{nearest(interface, known)};"
            f" interfaces are {', '.join([*known, ANY_PORT])}"
        )
    return known[interface]


# -- capturing -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Listening:
    """What to listen to: a port, and the protocol there (None: told by what is heard)."""

    port: str
    protocol: ProtocolModule | None
    setup: PortSetup

    @classmethod
    def parse(cls, port: str, protocol: str, options: Mapping[str, str]) -> Listening:
        """Options as text; those that the protocol does not have are left. Raises `UsageError`."""
        name = protocol or AUTO
        if name not in (AUTO, *PROTOCOLS):
            raise UsageError(f"protocol {name!r} is none of {', '.join([AUTO, *PROTOCOLS])}")
        given = {key: text for key, text in options.items() if text not in ("", DEFAULT)}
        every = {key: "" for known in PROTOCOLS.values() for key in known.options}
        leave = {
            "rts": "leave",
            "dtr": "leave",
        }  # whoever drives the line may need them as they are
        chosen = LineOptions.parse({**given, **leave}, every)
        module = None if name == AUTO else PROTOCOLS[name]
        settings = _settings(module or next(iter(PROTOCOLS.values())), chosen)
        return cls(port, module, PortSetup(settings, chosen))

    def line(self, protocol: ProtocolModule) -> Listened:
        """The line, once its protocol is known; it goes on as the port was opened."""
        opened, chosen = self.setup.settings, self.setup.options
        settings = _settings(protocol, chosen).with_options(baud=opened.baud, format=opened.format)
        return Listened(self.port, protocol, settings, own=_own(protocol, chosen))


def _own(protocol: ProtocolModule, chosen: LineOptions) -> dict[str, str]:
    return {key: text for key, text in chosen.own.items() if key in protocol.options}


def _settings(protocol: ProtocolModule, chosen: LineOptions) -> LineSettings:
    line = protocol.line_for(_own(protocol, chosen))
    return line.with_options(**chosen.line_settings())


def capture(listening: Listening, file: BinaryIO) -> None:
    """Write what is heard into `file` until nobody reads it any more. Raises `PortError`."""
    port = open_port(listening.port, listening.setup)
    try:
        writer = CaptureWriter(file)
        sniffer = Sniffer(
            *(port, listening.port, listening.setup.settings, listening.protocol, listening.line),
            writer=writer,
        )
        gone = select.poll()
        gone.register(file, 0)  # errors are always told
        try:
            for _ in sniffer.run():  # now and then, even if nothing is heard
                if writer.failed is not None or gone.poll(0):
                    break
        finally:
            sniffer.finish()
    finally:
        port.close()
