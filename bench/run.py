"""Runs the benchmarks: `python bench/run.py [ROW...] [--quick] [--write]`."""

from __future__ import annotations

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])  # the package is `bench`, not its files

    from bench.table import main

    raise SystemExit(main())
