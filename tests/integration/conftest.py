"""What tests of the world share: an audit log of their own, and a simulated line."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from integration.browser import Browser, browser
from integration.processes import DEVICES, Address, Simulator, simulator
from integration.threads import simulated
from integration.ways import WAYS, Way

# Who starts the tests in the background of a shell has Ctrl-C ignored, by every program they start too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def audit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The audit log of this test, and of the processes it starts."""
    path = tmp_path / "audit" / "audit.jsonl"
    monkeypatch.setenv("MULTIDROP_AUDIT", str(path))
    return path


@pytest.fixture(scope="module")
def plant() -> Iterator[Simulator]:
    """flexmax:0 with a card behind it, flexmax:1 and ax-v:2 over TCP, for tests that leave no trace."""
    with simulator() as started:
        yield started


@pytest.fixture(scope="module")
def window() -> Iterator[Browser]:
    """A browser, which is slow to start."""
    with browser() as opened:
        yield opened


@pytest.fixture
def fresh() -> Iterator[Address]:
    """The same devices with their default values, for one test alone."""
    with simulated(*DEVICES) as started:
        yield started


@pytest.fixture(params=WAYS, ids=lambda way: way.__name__)
def way(request: pytest.FixtureRequest) -> Way:
    """Through a blocking connection, and through an asyncio one."""
    found: Way = request.param
    return found
