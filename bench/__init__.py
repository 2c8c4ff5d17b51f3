"""Measurements against real peers. `make bench`, or `python bench/run.py [ROW...] [--quick]`."""
