"""A skipped test has failed where `MULTIDROP_NEEDS_ALL` is set, however it was skipped."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from integration.processes import PATIENCE, environment

CONFTEST = Path(__file__).resolve().parents[1] / "conftest.py"
SKIPPED = """
import pytest

@pytest.mark.skipif(True, reason="marked")
def test_marked(): pass

def test_inside(): pytest.importorskip("no_such_module")

@pytest.fixture
def absent(): pytest.skip("in a fixture")

def test_with_a_fixture(absent): pass

@pytest.mark.xfail(strict=True)
def test_that_is_expected_to_fail(): assert False

def test_that_runs(): pass
"""
WHOLE = 'import pytest\npytest.skip("the whole module", allow_module_level=True)\n'


@pytest.mark.parametrize(
    ("needed", "status", "outcome"),
    [
        ("", 0, "1 passed, 4 skipped, 1 xfailed"),
        ("1", 1, "1 failed, 1 passed, 1 xfailed, 3 errors"),
    ],
)
def test_nothing_is_skipped_where_all_is_needed(
    tmp_path: Path, needed: str, status: int, outcome: str
) -> None:
    shutil.copy(CONFTEST, tmp_path)
    (tmp_path / "test_some.py").write_text(SKIPPED)
    (tmp_path / "test_whole.py").write_text(WHOLE)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    ran = subprocess.run(
        [*command, "--continue-on-collection-errors", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=3 * PATIENCE,
        cwd=tmp_path,
        env=environment(MULTIDROP_NEEDS_ALL=needed, PYTHONWARNINGS=""),
        check=False,
    )
    assert ran.returncode == status, ran.stdout + ran.stderr
    assert outcome in ran.stdout, ran.stdout
