"""What `check` finds in the tables of the parts, each by its own part, before anything is opened."""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
from pathlib import Path

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.gateway import parts
from multidrop.gateway.check import check
from multidrop.gateway.history.sqlite import SqliteStore
from multidrop.gateway.outbox import Outbox
from multidrop.gateway.parts import PARTS
from multidrop.gateway.settings import CLASSES
from multidrop.plantfile import survey

LINES = """
[line.press]
port = "/dev/ttyUSB0"
[line.press.device.infeed]
profile = "flexmax"
address = 0
points = { speed = "actual_speed" }
"""
DSN = 'dsn = "postgresql://gw@db/plant"'
HEAD = "register,type,device,point\n"
FULL = "".join(f"{register},int16,old,p{register}\n" for register in range(65400, 65536))


def wrong(folder: Path, tables: str) -> list[str]:
    """What is wrong with these tables; each begins with the plant file's name."""
    file = folder / "multidrop.toml"
    found = check(survey(LINES + tables, str(file), load_profile)).wrong
    assert all(text.startswith(f"{file}: ") for text in found)
    return [text.removeprefix(f"{file}: ").replace(f"{folder}/", "") for text in found]


def everything(folder: Path) -> dict[str, object]:
    return {
        str(path.relative_to(folder)): (
            path.stat().st_mtime_ns,
            path.is_file() and path.read_bytes(),
        )
        for path in folder.rglob("*")
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that are not what a table may want, and some that are: a disk takes its time for those."""
    tmp_path = tmp_path_factory.mktemp("made")
    (tmp_path / "folder").mkdir()
    (tmp_path / "text").write_text(
        "no database, no certificate, and long enough to be seen as such\n"
    )
    (tmp_path / "empty").write_text("")
    (tmp_path / "latin").write_bytes(b"\xe4\xf6\n")
    with sqlite3.connect(tmp_path / "other.db") as other:
        other.execute("CREATE TABLE theirs (id)")
    other.close()
    SqliteStore(tmp_path / "ours.db").close()
    Outbox(tmp_path / "outbox.db", 1000).close()
    (tmp_path / "twice.csv").write_text(HEAD + "0,int16,infeed,speed\n0,int16,infeed,torque\n")
    (tmp_path / "full.csv").write_text(HEAD + FULL)
    (tmp_path / "tokens.toml").write_text('[ann]\nsha256 = "short"\nrights = ["read"]\n')
    return tmp_path


@pytest.fixture
def files(made: Path, tmp_path: Path) -> Path:
    """The same in a folder of the test's own."""
    return shutil.copytree(made, tmp_path / "site")


def test_every_table_has_a_part_that_is_asked() -> None:
    assert set(PARTS) == set(CLASSES)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ("[faults]\npath = 'text'", ["faults.path text: it is no folder"]),
        (
            "[faults]\npath = 'text/below/it'",
            ["faults.path text/below/it: there is no folder text"],
        ),
        ("[history]\npath = 'folder'", ["history.path folder: it is a folder"]),
        ("[history]\npath = 'no/h.db'", ["history.path no/h.db: there is no folder no"]),
        ("[history]\npath = 'other.db'", ["history.path other.db: not a history of multidrop"]),
        ("[history]\npath = 'outbox.db'", ["history.path outbox.db: not a history of multidrop"]),
        (
            "[history]\npath = 'text'",
            ["history.path text: no history can be kept here: file is not a database"],
        ),
        (
            "[history]\ndsn = 'postgresql://db/plant?ssl=on'",
            ['history.dsn is wrong: invalid URI query parameter: "ssl"'],
        ),
        (
            f"[history]\n{DSN}\noutbox = 'ours.db'",
            ["history.outbox ours.db: not an outbox of multidrop"],
        ),
        (
            f"[history]\n{DSN}\noutbox = 'text'",
            ["history.outbox text: no outbox: file is not a database"],
        ),
        (
            "[history]\ndsn = 'nonsense'\noutbox = 'no/o.db'",
            [
                'history.dsn is wrong: missing "=" after "nonsense" in connection info string',
                "history.outbox no/o.db: there is no folder no",
            ],
        ),
        ("[http]\nlisten = 'here'", ["http.listen is 'here', which is not HOST:PORT"]),
        ("[http]\ncertificate = 'text'", ["http.certificate and http.key belong together"]),
        (
            "[http]\ncertificate = 'text'\nkey = 'nowhere'",
            ["http.key nowhere: No such file or directory"],
        ),
        (
            "[http]\ncertificate = 'folder'\nkey = 'text'",
            ["http.certificate folder: Is a directory"],
        ),
        ("[http]\ntokens = 'nowhere'", ["http.tokens nowhere: No such file or directory"]),
        (
            "[http]\ntokens = 'tokens.toml'",
            [
                "http.tokens tokens.toml: ann.sha256 is not 64 hexadecimal digits: "
                "make it with multidrop token"
            ],
        ),
        ("[modbus]\nlisten = '5020'", ["modbus.listen is '5020', which is not HOST:PORT"]),
        (
            "[modbus]\nmap = 'folder'",
            ["modbus.map: folder: Is a directory", "modbus.map folder: it is a folder"],
        ),
        ("[modbus]\nmap = 'latin'", ["modbus.map: latin: not UTF-8"]),
        ("[modbus]\nmap = 'no/map.csv'", ["modbus.map no/map.csv: there is no folder no"]),
        (
            "[modbus]\nmap = 'twice.csv'",
            ["modbus.map: twice.csv: infeed speed at 0 and infeed torque at 0 overlap"],
        ),
        (
            "[modbus]\nmap = 'full.csv'",
            ["modbus.map: the register map is full: there is no room for infeed"],
        ),
        ("[mqtt]\nhost = ''", ["mqtt.host is empty: there is no broker at ''"]),
        (
            "[mqtt]\nhost = 'b'\nport = 65536",
            ["mqtt.port is 65536, and 65535 the highest: there is no broker at it"],
        ),
        (
            "[mqtt]\nhost = 'b'\ntopic = '#'\ndiscovery = '+'\nauthority = 'x'\npassword = 'x'",
            [
                "mqtt.authority is given, but not tls = true",
                "mqtt.password is given, but no user",
                "mqtt.topic is '#', which is no first part of topics, such as plant/a",
                "mqtt.discovery is '+', which is no first part of topics, such as plant/a",
            ],
        ),
        (
            "[mqtt]\nhost = 'b'\ntls = true\nauthority = 'nowhere'",
            ["mqtt.authority nowhere: No such file or directory"],
        ),
        (
            "[mqtt]\nhost = 'b'\nuser = 'x'\npassword = 'nowhere'",
            ["mqtt.password nowhere: No such file or directory"],
        ),
        (
            "[mqtt]\nhost = 'b'\noutbox = 'ours.db'",
            ["mqtt.outbox ours.db: not an outbox of multidrop"],
        ),
        (
            "[mqtt]\nhost = 'b'\noutbox = 'no/o.db'",
            ["mqtt.outbox no/o.db: there is no folder no"],
        ),
        (
            f"[history]\n{DSN}\n[mqtt]\nhost = 'b'\noutbox = 'history-outbox.db'",
            ["mqtt.outbox is history-outbox.db, and so is history.outbox"],
        ),
        (
            "[history]\n[mqtt]\nhost = 'b'\noutbox = 'history.db'",
            ["mqtt.outbox is history.db, and so is history.path"],
        ),
        ("[mqtt]\nhost = 'b'\noutbox = 'outbox.db'", []),
        (
            "[http]\nlisten = '127.0.0.1:5020'\n[modbus]",
            ["modbus.listen is '127.0.0.1:5020', and so is http.listen"],
        ),
        ("[http]\nlisten = '127.0.0.1:0'\n[modbus]\nlisten = '127.0.0.1:0'", []),
        ("[history]\npath = 'empty'\n[faults]\npath = 'a/b'\n[modbus]\n[mqtt]\nhost = 'b'", []),
        ("[history]\npath = 'ours.db'", []),
        (f"[history]\n{DSN}\noutbox = 'outbox.db'", []),
    ],
)
def test_what_is_wrong_is_found_and_nothing_is_touched(
    files: Path, tables: str, said: list[str]
) -> None:
    before = everything(files)
    assert wrong(files, tables) == said
    assert everything(files) == before


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_a_certificate_that_is_not_of_its_key(files: Path) -> None:
    for name in ("a", "b"):
        new = f"openssl req -x509 -newkey rsa:2048 -nodes -subj /CN=x -keyout {name}.key -out {name}.pem"
        subprocess.run(new.split(), cwd=files, check=True, capture_output=True)
    locked = "openssl rsa -aes256 -passout pass:secret -in a.key -out locked.key"
    subprocess.run(locked.split(), cwd=files, check=True, capture_output=True)
    assert wrong(files, "[http]\ncertificate = 'a.pem'\nkey = 'a.key'") == []
    for key, reason in (
        ("b.key", "KEY_VALUES_MISMATCH"),
        ("text", "not PEM, or the key has a password"),
        ("locked.key", "not PEM, or the key has a password"),
    ):
        (said,) = wrong(files, f"[http]\ncertificate = 'a.pem'\nkey = '{key}'")
        assert said == f"http.certificate a.pem and http.key {key} are no pair: {reason}"


def test_a_folder_that_may_not_be_written(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)  # root may write anywhere
    tables = "[history]\npath = 'ours.db'\n[modbus]\n[faults]\npath = 'folder'"
    assert wrong(files, tables) == [
        "history.path ours.db: it cannot be written",
        "faults.path folder: it cannot be written",
        f"modbus.map registers.csv: it cannot be made, for {files} cannot be written",
    ]


def test_a_part_that_is_not_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise UsageError("[faults] needs more")

    monkeypatch.setattr(parts, "import_module", missing)
    assert wrong(tmp_path, "[faults]") == ["[faults] needs more"]
