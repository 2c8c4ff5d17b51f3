# make demo    a simulated plant and its page
# make test    lint, types and tests
# Both set up what they need in .venv: Python 3.11 or newer with pip and venv is enough.

PYTHON ?= python3
BIN := .venv/bin
PIP := PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install --quiet --constraint constraints.txt

COVERED := tests/vectors tests/dialogues tests/unit/protocols $(wildcard tests/unit/test_*.py)
OTHERS := tests/integration tests/properties tests/soak tests/test_architecture.py \
    $(filter-out tests/unit/protocols,$(patsubst %/__init__.py,%,$(wildcard tests/unit/*/__init__.py)))

# The tests start the program many hundred times: it is compiled once.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check tshark mbpoll mosquitto chromium soak bench fuzz docs clean

demo: .venv/gateway
	@$(BIN)/multidrop demo

# So many processes of pytest share the tests: who has none left takes of another's. (-n would start
# them without -bb.)
shared_by = --dist worksteal --tx '$(1)*popen//python=$(BIN)/python -bb'

# The pure floors' own tests must reach every branch of them. The properties need not help, and being
# measured would double their time. More of the others run at once than there are processors, since
# they wait most of their time.
test: check .venv/dev
	@rm -f .coverage .coverage.*
	$(BIN)/python -bb -m coverage run -m pytest $(call shared_by,2) $(COVERED)
	@$(BIN)/coverage combine --quiet
	@$(BIN)/coverage report --fail-under=100 \
	    --include='src/multidrop/*.py,src/multidrop/protocols/*' \
	    --omit='src/multidrop/__*__.py,src/multidrop/catalog.py,src/multidrop/plantfile.py,src/multidrop/naming.py'
	$(BIN)/python -bb -m pytest $(call shared_by,5) $(OTHERS)

check: .venv/dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python docs/generate.py --check

# Programs that some tests need; without them those are skipped and say so.
tshark mbpoll mosquitto: PACKAGES = $@
mosquitto: PACKAGES += mosquitto-clients openssl
tshark mbpoll mosquitto:
	@PATH="$$PATH:/usr/sbin"; command -v $@ >/dev/null || { \
	    test "$$(id -u)" = 0 && command -v apt-get >/dev/null || \
	        { echo "$@ is missing; on Debian and Ubuntu: sudo make $@" >&2; exit 1; }; \
	    apt-get -qq update && \
	        DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends $(PACKAGES); }

# What the tests of the page need; without it they are skipped and say so.
chromium:
	@command -v chromedriver >/dev/null || { test "$$(id -u)" = 0 && command -v apt-get >/dev/null; } || \
	    { echo "chromium and its driver are missing; on Debian: sudo make chromium" >&2; exit 1; }
	@command -v chromedriver >/dev/null || { apt-get -qq update && \
	    DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends chromium chromium-driver fonts-dejavu-core; }

# Properties with 100,000 generated cases each, and 10,000 transactions on every kind of faulty wire: hours.
soak: .venv/dev
	HYPOTHESIS_PROFILE=soak MULTIDROP_SOAK=1 nice $(BIN)/python -bb -m pytest $(call shared_by,2) tests/properties tests/soak tests/unit

bench: .venv/bench
	$(BIN)/python bench/run.py

fuzz: .venv/fuzz
	for name in slink3 datalink ultra3000; do $(BIN)/python fuzz/fuzz_$$name.py -max_total_time=600 || exit 1; done

# The generated pages, and the output that the pages show.
docs: .venv/dev
	$(BIN)/python docs/generate.py
	$(BIN)/python docs/outputs.py

.venv/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "multidrop needs Python 3.11 or newer; $(PYTHON) is older: make PYTHON=python3.11 ..." >&2; exit 1; }
	@echo "setting up .venv ..."
	@$(PYTHON) -m venv .venv
	@touch $@

.venv/base: .venv/python pyproject.toml constraints.txt
	@$(PIP) --editable .
	@touch $@

.venv/gateway .venv/dev .venv/bench .venv/fuzz: .venv/%: .venv/base
	@$(PIP) --editable '.[$*]'
	@touch $@

clean:
	rm -rf .venv dist build .coverage .coverage.* .hypothesis .mypy_cache .pytest_cache .ruff_cache
