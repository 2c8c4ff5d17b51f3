"""Who may ask over HTTP: where it listens, by which names, with which token. No server in here.

A web page from elsewhere runs in the same browser as ours, and a browser does much of
what such a page wants. So a request has to name this server (Host), must not come from
another site (Origin, Sec-Fetch-Site), and one that writes carries a token, which no
browser adds by itself.
"""

from __future__ import annotations

import socket
from collections.abc import Mapping
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from ssl import PROTOCOL_TLS_SERVER, SSLContext, SSLError
from urllib.parse import urlsplit

from multidrop.errors import UsageError
from multidrop.gateway.settings import HttpSettings, Settings
from multidrop.gateway.web.tokens import Right, Token, TokenFile
from multidrop.numerals import is_digits

HOW = """\
    multidrop token NAME --write -o tokens.toml
    openssl req -x509 -newkey rsa:2048 -nodes -days 825 -subj /CN={name} \\
        -addext subjectAltName=DNS:{name} -keyout key.pem -out certificate.pem
and in [http]:
    tokens = "tokens.toml"
    certificate = "certificate.pem"
    key = "key.pem\""""
"""What somebody types who wants it reachable from other machines."""


class Refused(Exception):
    """A request that is not answered: HTTP status and reason."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status
        self.reason = reason


def split_address(text: str) -> tuple[str, int]:
    """`127.0.0.1:8080` or `[::1]:8080`. Raises `UsageError`."""
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not is_digits(port) or int(port) > 65535:
        raise UsageError(f"http.listen is {text!r}, which is not HOST:PORT")
    return host, int(port)


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach it. A name other than localhost may be anything."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


@dataclass(frozen=True, slots=True)
class Place:
    """Where the server listens, and with what certificate."""

    host: str
    port: int
    certificate: Path | None = None
    key: Path | None = None

    @property
    def loopback(self) -> bool:
        return is_loopback(self.host)

    @property
    def scheme(self) -> str:
        return "https" if self.certificate else "http"

    def url(self, port: int) -> str:
        """What to type into a browser. `port` is the one that was got where 0 was asked for."""
        host = socket.gethostname() if self.host in ("0.0.0.0", "::") else self.host
        shown = f"[{host}]" if ":" in host else host
        return f"{self.scheme}://{shown}:{port}/"


def place_of(settings: Settings) -> Place:
    """Where to listen. Raises `UsageError` where that is not safe, and says how to make it so."""
    http = settings.http or HttpSettings()
    host, port = split_address(http.listen)
    place = Place(host, port, *certificate_of(settings))
    tokens = tokens_of(settings).all()
    if not place.loopback and not (tokens and place.certificate):
        missing = " and ".join(
            ["a token"] * (not tokens) + ["a TLS certificate"] * (place.certificate is None)
        )
        raise UsageError(
            f"http.listen is {http.listen}, which other machines can reach; that needs {missing}.\n"
            + HOW.format(name=socket.gethostname())
        )
    return place


def tokens_of(settings: Settings) -> TokenFile:
    """The tokens that `[http]` names."""
    http = settings.http or HttpSettings()
    return TokenFile(None if http.tokens is None else settings.path(http.tokens))


def certificate_of(settings: Settings) -> tuple[Path, Path] | tuple[()]:
    """The files of the certificate and its key. Raises `UsageError` where they cannot be read."""
    http = settings.http or HttpSettings()
    if (http.certificate is None) != (http.key is None):
        raise UsageError("http.certificate and http.key belong together")
    if http.certificate is None or http.key is None:
        return ()
    named = {"http.certificate": http.certificate, "http.key": http.key}
    paths = {key: settings.path(name) for key, name in named.items()}
    for key, path in paths.items():
        try:
            path.open("rb").close()
        except OSError as error:
            raise UsageError(f"{key} {path}: {error.strerror}") from None
    certificate, key_file = paths.values()
    return certificate, key_file


def demand_pair(certificate: Path, key: Path) -> None:
    """Raises `UsageError` where they cannot be used together."""
    try:
        SSLContext(PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, _no_password)
    except SSLError as error:
        reason = error.reason or "not PEM, or the key has a password"
        raise UsageError(
            f"http.certificate {certificate} and http.key {key} are no pair: {reason}"
        ) from None


def _no_password() -> str:
    """A gateway that starts at night has nobody who types one."""
    return ""


class Access:
    """Decides about requests."""

    def __init__(self, place: Place, names: tuple[str, ...], tokens: TokenFile) -> None:
        self._place = place
        self._names = {name.lower() for name in (*names, "localhost", socket.gethostname())}
        self._names.add(place.host.lower())
        self._tokens = tokens

    def check_origin(self, headers: Mapping[str, str]) -> None:
        """Raises `Refused` for a request that was made for another server, or by another site."""
        host = headers.get("host", "")
        if not self._is_ours(host):
            raise Refused(
                421, f"this server is not called {host!r}: add the name to names in [http]"
            )
        origin = headers.get("origin")
        own = {f"{self._place.scheme}://{host}".lower(), f"https://{host}".lower()}
        if origin is not None and origin.lower() not in own:  # https: a proxy stands before us
            raise Refused(403, f"requests of other sites are refused: {origin!r}")
        if (
            headers.get("sec-fetch-site") in ("cross-site", "same-site")
            and headers.get("sec-fetch-mode") != "navigate"
        ):
            raise Refused(403, "requests of other sites are refused")

    def _is_ours(self, host: str) -> bool:
        """An address is nobody's name, so nobody else can have made it point here."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
            urlsplit(f"//{host}").port  # noqa: B018 - raises for a port that is none
        except ValueError:
            return False
        if "@" in host or "/" in host:
            return False
        try:
            return bool(ip_address(name))
        except ValueError:
            return name.lower() in self._names

    def who(self, headers: Mapping[str, str], right: Right) -> Token | None:
        """Who asks; None is somebody on this machine who only reads. Raises `Refused`."""
        given = headers.get("authorization")
        if given is None:
            if right is Right.READ and self._place.loopback:
                return None
            raise Refused(401, f"a token with the right to {right} is needed")
        scheme, _, secret = given.partition(" ")
        token = self._tokens.find(secret.strip()) if scheme.lower() == "bearer" else None
        if token is None:
            raise Refused(401, "this token is not known")
        if right not in token.rights:
            raise Refused(403, f"token {token.name} has no right to {right}")
        return token
