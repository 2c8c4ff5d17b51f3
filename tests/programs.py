"""Programs that some tests need. Without one a test is skipped, which MULTIDROP_NEEDS_ALL makes a failure."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

ELSEWHERE = ("/usr/sbin", "/usr/local/bin", *map(str, Path("/usr/lib/postgresql").glob("*/bin")))
"""Where Debian has some of them, outside the path of a user."""


def program(name: str, how: str = "") -> str:
    """Where it is. Skips the test if it is nowhere, and says `how` it is installed."""
    found = shutil.which(name, path=os.pathsep.join([os.environ["PATH"], *ELSEWHERE]))
    if found is None:
        pytest.skip(f"{name} is not installed ({how})" if how else f"{name} is not installed")
    return found
