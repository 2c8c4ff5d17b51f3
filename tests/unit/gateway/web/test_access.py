"""Who may ask over HTTP: addresses, tokens, and what other machines need."""

from __future__ import annotations

from pathlib import Path

import pytest

from multidrop.errors import UsageError
from multidrop.gateway.settings import HttpSettings, Settings
from multidrop.gateway.web.access import (
    Access,
    Place,
    Refused,
    is_loopback,
    place_of,
    split_address,
)
from multidrop.gateway.web.tokens import Right, TokenFile, make_token, read_tokens


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("127.0.0.1:8080", ("127.0.0.1", 8080)),
        ("[::1]:1", ("::1", 1)),
        ("gateway.example:65535", ("gateway.example", 65535)),
    ],
)
def test_an_address(text: str, address: tuple[str, int]) -> None:
    assert split_address(text) == address


@pytest.mark.parametrize("text", ["", "8080", ":8080", "a:", "a:b", "a:65536", "a:-1", "a:٣"])
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(UsageError, match="not HOST:PORT"):
        split_address(text)


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("::1", True),
        ("LocalHost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("10.0.0.1", False),
        ("localhost.evil.example", False),
    ],
)
def test_what_only_this_machine_reaches(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback


def placed(folder: Path, **keys: str) -> Place:
    return place_of(Settings(folder, http=HttpSettings(**keys)))  # type: ignore[arg-type]


def test_other_machines_need_both(tmp_path: Path) -> None:
    """A token without TLS would be read on its way, TLS without a token would let everybody in."""
    for name in ("c.pem", "k.pem"):
        (tmp_path / name).touch()
    tls = {"certificate": "c.pem", "key": "k.pem"}
    with pytest.raises(UsageError, match="needs a token and a TLS certificate"):
        placed(tmp_path, listen="0.0.0.0:1")
    with pytest.raises(UsageError, match=r"needs a token\."):
        placed(tmp_path, listen="0.0.0.0:1", **tls)
    (tmp_path / "none.toml").touch()
    with pytest.raises(UsageError, match=r"needs a token\."):
        placed(tmp_path, listen="0.0.0.0:1", tokens="none.toml", **tls)
    make_token(tmp_path / "t.toml", "ann", [Right.READ])
    with pytest.raises(UsageError, match="needs a TLS certificate"):
        placed(tmp_path, listen="gateway.example:1", tokens="t.toml")
    place = placed(tmp_path, listen="10.0.0.1:1", tokens="t.toml", **tls)
    assert place.url(1) == "https://10.0.0.1:1/"
    assert placed(tmp_path, listen="[::1]:1").url(7) == "http://[::1]:7/"


def test_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="belong together"):
        placed(tmp_path, certificate="c.pem")
    with pytest.raises(UsageError, match=r"http\.certificate .*c\.pem: No such file"):
        placed(tmp_path, certificate="c.pem", key="k.pem")
    with pytest.raises(UsageError, match="No such file"):
        placed(tmp_path, tokens="t.toml")


@pytest.mark.parametrize(
    "text",
    ["x = 1", "[a]", '[a]\nsha256 = "x"\nrights = ["read"]', "[a]\nsha256 = 1\nrights = []", "[",
     f'[a]\nsha256 = "{"0" * 64}"\nrights = ["all"]', f'[a]\nsha256 = "{"0" * 64}"\nrights = []'],
)  # fmt: skip
def test_tokens_that_are_none(tmp_path: Path, text: str) -> None:
    file = tmp_path / "t.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=r"t\.toml"):
        read_tokens(file)


def test_on_another_address_reading_needs_a_token_too(tmp_path: Path) -> None:
    file = tmp_path / "t.toml"
    writer = make_token(file, "writer", [Right.WRITE])
    access = Access(Place("10.0.0.1", 1, file, file), (), TokenFile(file))
    for right in Right:
        with pytest.raises(Refused) as refused:
            access.who({}, right)
        assert refused.value.status == 401
    headers = {"authorization": f"Bearer {writer}"}
    with pytest.raises(Refused) as refused:
        access.who(headers, Right.READ)
    assert refused.value.status == 403
    token = access.who(headers, Right.WRITE)
    assert token is not None
    assert token.name == "writer"


def test_names_of_its_own() -> None:
    access = Access(Place("10.0.0.1", 1), ("plant.example",), TokenFile(None))
    for host in ("plant.example", "PLANT.example:99", "10.0.0.1", "[fe80::1]:1"):
        access.check_origin({"host": host})
    for host in ("other.example", "plant.example.evil.example", "plant.example@evil.example"):
        with pytest.raises(Refused):
            access.check_origin({"host": host})
