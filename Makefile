# make demo    a simulated plant, live in the terminal
# make test    lint, types and tests
# Both set up what they need in .venv: Python 3.11 or newer with pip and venv is enough.

PYTHON ?= python3
BIN := .venv/bin
PIP := PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install --quiet --constraint constraints.txt

.PHONY: demo test check soak bench fuzz docs clean

demo: .venv/base
	@$(BIN)/multidrop demo

test: check .venv/dev
	$(BIN)/python -bb -m coverage run -m pytest
	@$(BIN)/coverage report --fail-under=100 \
	    --include='src/multidrop/*.py,src/multidrop/protocols/*' \
	    --omit='src/multidrop/__init__.py,src/multidrop/catalog.py,src/multidrop/plantfile.py,src/multidrop/naming.py'

check: .venv/dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

# The same tests with 100,000 generated cases and 10,000 transactions on a faulty wire.
soak: .venv/dev
	HYPOTHESIS_PROFILE=soak MULTIDROP_SOAK=1 $(BIN)/python -bb -m pytest tests/properties tests/soak tests/unit/protocols

bench: .venv/bench
	$(BIN)/python bench/run.py

fuzz: .venv/fuzz
	$(BIN)/python fuzz/fuzz_slink3.py -max_total_time=600

docs: .venv/dev
	$(BIN)/python docs/generate.py

.venv/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "multidrop needs Python 3.11 or newer; $(PYTHON) is older: make PYTHON=python3.11 ..." >&2; exit 1; }
	@echo "setting up .venv ..."
	@$(PYTHON) -m venv .venv
	@touch $@

.venv/base: .venv/python pyproject.toml constraints.txt
	@$(PIP) --editable .
	@touch $@

.venv/dev .venv/bench .venv/fuzz: .venv/%: .venv/base
	@$(PIP) --editable '.[$*]'
	@touch $@

clean:
	rm -rf .venv dist build .coverage .hypothesis .mypy_cache .pytest_cache .ruff_cache
