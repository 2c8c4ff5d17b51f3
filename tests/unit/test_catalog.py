"""Profiles of one's own, as they are found in files."""

from __future__ import annotations

from pathlib import Path

import pytest

from multidrop.catalog import profile_file
from multidrop.errors import UsageError

PROFILE = """[profile]
name = "mixer"
protocol = "datalink"
title = "A mixer"
dialect = "map-a"
[points.{name}]
at = "C250"
role = "setting"
"""


def test_a_name_that_is_another_place_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mixer.toml"
    path.write_text(PROFILE.format(name="C10"))
    with pytest.raises(UsageError, match=r"mixer\.toml: points\.C10: .* a place of its own"):
        profile_file(path)
