"""`python -m bench` is `python bench/run.py`."""

from bench.table import main

raise SystemExit(main())
